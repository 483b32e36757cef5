"""Full and failing disks at random moments of a run: `python tests/faults/failing_disks.py FIRST COUNT FOLDER`.

In each trial, a call that writes below the folder of the run fails, or all from it on, as on a full disk, at a quota or
on a failing device. A trial runs in a process of its own, which may crash. Its seed determines the call.
"""

import ctypes
import errno
import faulthandler
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parents[2]))  # as pytest does

#: Longest time of a trial, s.
LONGEST = 600
#: Errors of a full disk, a quota, the largest size of a file, and a device.
ERRORS = (errno.ENOSPC, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EIO)


def build(folder: Path) -> Path:
    """Compile the library that lets writes fail."""
    built = folder / "failing_disk.so"
    source = Path(__file__).with_name("failing_disk.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", str(built), str(source), "-ldl"], check=True)
    return built


def preloaded() -> ctypes.CDLL:
    """Return the library, after this process has begun again with it."""
    if "LD_PRELOAD" not in os.environ:
        with tempfile.TemporaryDirectory() as folder:
            os.environ["LD_PRELOAD"] = str(build(Path(folder)))
            code = subprocess.call([sys.executable, *sys.argv])
        sys.exit(code)
    library = ctypes.CDLL(os.environ["LD_PRELOAD"])
    library.failing_disk_calls.restype = ctypes.c_long
    return library


def trial(seed: int, folder: Path, calls: tuple[int, int]) -> dict[str, Any]:
    """Run one trial in this process; `wrong` of the answer is empty if nothing is.

    Parameters
    ----------
    seed : seed; 0 for a run in which nothing fails
    folder : empty folder
    calls : numbers of the calls of a whole run, and of those before the transfer of registers
    """
    from calstation.errors import CalstationError
    from calstation.records import open_log
    from calstation.registers import journal as register_journal
    from calstation.runs import finish_incomplete
    from calstation.sequencer import Event, Fault, Finalized, Message
    from tests.site_folder import SiteFolder

    chance = random.Random(seed)
    number, only_once = chance.choice(ERRORS), chance.random() < 0.3
    first = chance.choice((chance.randint(1, calls[1]), chance.randint(calls[1], calls[0]))) if seed else 0
    library = preloaded()
    site = SiteFolder(folder)
    site.write(report_file=str(folder / "bench.json"), flash_file=str(folder / "flash"))
    site.runs.mkdir()
    found: dict[str, Any] = {"first": first, "error": errno.errorcode[number], "once": only_once}
    library.failing_disk(str(site.runs).encode(), ctypes.c_long(first), number, only_once)
    before = 0

    def emit(event: Event) -> None:
        nonlocal before
        site.events.append(event)
        if isinstance(event, Message) and event.id == "registers_reading":
            before = library.failing_disk_calls()

    error: CalstationError | None = None
    try:
        site.execute(emit, "rate")
    except CalstationError as exc:
        error = exc
    found["calls"] = library.failing_disk_calls()
    found["before_transfer"] = before
    library.failing_disk(b"", ctypes.c_long(0), 0, 0)
    ids = [event.id for event in site.events_of(Message)]
    faults = site.events_of(Fault)
    found["code"] = error.exit_code if error else None
    ends = site.events_of(Finalized)
    if not ends:
        found["end"] = error.code if error else "?"
        found["wrong"] = "no end" if error is None or error.exit_code not in (2, 3) else ""
        return found
    (end,) = ends
    found["end"] = str(end.verdict)
    found["faults"] = [fault.code for fault in faults]
    log, result = Path(end.log), Path(end.result_file)
    missing = not result.exists()
    finish_incomplete(site.runs)
    entries = register_journal.history(site.runs, "SN-000042")
    found["journal"] = [entry.closing for entry in entries]
    state = json.loads((folder / "bench.json").read_text(encoding="utf-8"))
    written = "registers_written" in ids
    # A failing device cannot store that the run passed: the journal tells what was written, and the run says so.
    is_excused = number == errno.EIO and missing and "not_stored" in ids and (not written or bool(entries))
    wrong = ""
    if error is not None:
        wrong = f"error {error.code}"
    elif written and not end.verdict.passed:
        wrong = "a written unit is lost"
    elif not written and end.verdict.passed:
        wrong = "passed without registers"
    elif missing and "not_stored" not in ids:
        wrong = "the missing result was not reported"
    elif state["enabled"] or state["moving"] or state["fault"] != "NONE":
        wrong = f"table {state}"
    elif "registers_transfer" in ids and not entries and "journal.unwritable" not in found["faults"]:
        wrong = "no journal of the transfer"
    elif any(fault.exit_code not in (2, 3) for fault in faults):
        wrong = f"exit codes {[fault.exit_code for fault in faults]}"
    if wrong or is_excused:
        return found | {"wrong": wrong, "excused": is_excused}
    try:
        stored = json.loads(result.read_text(encoding="utf-8"))
        digest = open_log(log).facts().sha256
    except (OSError, ValueError, CalstationError) as exc:
        return found | {"wrong": f"unreadable: {exc}"}
    found["stored"] = stored["outcome"]
    if stored["registers"] != end.result["registers"] or stored["outcome"] != end.result["outcome"]:
        wrong = "the stored result differs"
    elif digest != stored["log"]["sha256"] and (number, stored["outcome"]) != (errno.EIO, "fault"):  # a part is lost
        wrong = "digest of the log"
    return found | {"wrong": wrong}


def run(seed: int, folder: Path, calls: tuple[int, int]) -> dict[str, Any]:
    """Run a trial in a forked process."""
    reader, writer = os.pipe()
    if (pid := os.fork()) == 0:
        faulthandler.enable()
        try:
            found = trial(seed, folder, calls)
        except BaseException:  # noqa: BLE001 - reported
            found = {"wrong": traceback.format_exc()[-1500:]}
        os.write(writer, json.dumps(found, default=str).encode())
        os._exit(0)
    os.close(writer)
    end = time.monotonic() + LONGEST
    while (ended := os.waitpid(pid, os.WNOHANG)) == (0, 0) and time.monotonic() < end:
        time.sleep(0.05)
    if ended == (0, 0):
        os.kill(pid, 9)
        ended = os.waitpid(pid, 0)
    with os.fdopen(reader, "rb") as stream:
        content = stream.read()
    return json.loads(content) if content else {"wrong": f"the process ended with status {ended[1]}"}


def main(first: int, count: int, folder: Path) -> int:
    """Run trials in order, print each and the summary; return the number of failures."""
    import tests.site_folder  # noqa: F401 - imports what a run needs before processes are forked

    ends, failures = Counter[str](), 0
    whole = run(0, Path(tempfile.mkdtemp(prefix="whole-", dir=folder)), (1, 1))
    print(json.dumps(whole), flush=True)
    for seed in range(first, first + count):
        place = Path(tempfile.mkdtemp(prefix=f"{seed}-", dir=folder))
        found = run(seed, place, (whole["calls"], whole["before_transfer"]))
        ends[str(found.get("end"))] += 1
        failures += bool(found["wrong"])
        print(json.dumps({"seed": seed, **found}), flush=True)
        if not found["wrong"]:
            shutil.rmtree(place)
    print(json.dumps({"trials": count, "failures": failures, "ends": ends}), flush=True)
    return failures


if __name__ == "__main__":
    preloaded()
    sys.exit(min(1, main(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))))
