"""Signals at random moments to every process of a run: `python tests/faults/random_signals.py FIRST COUNT FOLDER`.

A trial starts a run on the virtual bench by command or in the window, sends one signal or two to the command or window,
the engine, the bench, or to all processes of the terminal, at the start of that process, at any later moment, or while
registers are written, and checks exit code, files and table. The seed of a trial determines everything but the load.
"""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from calstation.records import open_log

sys.path.append(str(Path(__file__).parents[2]))  # as pytest does

from tests.site_folder import SiteFolder

#: Each says when its own code begins: before, Python itself ends.
_COMMAND = """
import sys
from calstation.cli import main
from calstation.cli.process import prepare
prepare()
print("begun", file=sys.stderr, flush=True)
main()
"""
_WINDOW = """
import sys
from pathlib import Path
from calstation.cli import main
from calstation.cli.process import prepare
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QLineEdit, QPushButton
from calstation.gui import shell
create = shell.create_window
station = Path(sys.argv.pop())
def started():
    window = create(station)
    def begin():
        window.findChild(QLineEdit, "serial_edit").setText("SN-000042")
        window.findChild(QPushButton, "start_button").click()
    QTimer.singleShot(300, window, begin)
    return window
shell.create_window = started
prepare()
print("begun", file=sys.stderr, flush=True)
main()
"""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
TARGETS = ("command", "command", "terminal", "terminal", "engine", "engine", "bench", "window")
#: Multiple of real time, and longest time of a trial and until a command ends after a signal, s.
SPEED, LONGEST, STOPS_WITHIN = 6.0, 500.0, 200.0


class Trial:
    """One run and the signals to it."""

    def __init__(self, seed: int, folder: Path) -> None:
        self._chance = chance = random.Random(seed)
        self.target = TARGETS[seed % len(TARGETS)]
        moments = ("start", "start", "random", "random", "transfer")
        self.moment = chance.choice(moments[: 4 if self.target == "window" else 5])
        self.signals = [chance.choice(SIGNALS) for _ in range(chance.choice((1, 1, 1, 2)))]
        self.delay = chance.uniform(0.0, 9.0 if self.moment == "random" else 0.8)
        self.pause = chance.choice((0.0, 0.02, 0.5))
        self._folder = folder
        self.errors = list[str]()

    def run(self) -> dict[str, Any]:
        """Run the trial; `wrong` of the answer is empty if nothing is."""
        home = self._folder / "home"
        site = SiteFolder(self._folder, home if self.target == "window" else None)
        site.write(speed=SPEED, report_file=str(self._folder / "bench.json"), flash_file=str(self._folder / "flash"))
        arguments: list[object] = [sys.executable, "-c", _WINDOW, site.station]
        if self.target != "window":
            arguments = [sys.executable, "-c", _COMMAND, "run", "--yes", "--serial", "SN-000042", "--out", site.runs]
            arguments += ["--station", site.station, "--product", site.product, "--json", self._folder / "out.json"]
            arguments += ["--stages", "rate"]
        environment = {**os.environ, "CALSTATION_HOME": str(home), "COLUMNS": "200", "QT_QPA_PLATFORM": "offscreen"}
        process = subprocess.Popen(
            list(map(str, arguments)),
            env=environment,
            cwd=self._folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            process_group=0,
            preexec_fn=_restore_signals,
        )
        reader = threading.Thread(target=self._read, args=(process,), daemon=True)
        reader.start()
        sent = self._send(process)
        try:
            code: int | None = process.wait(LONGEST if self._may_go_on else STOPS_WITHIN)
        except subprocess.TimeoutExpired:
            code = None
        ended = time.time()
        left = [name for name in ("engine", "bench") if _alive(self._pids.get(name))]
        for pid in [process.pid, *self._pids.values()]:
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        process.wait()
        reader.join(5.0)
        found = {"target": self.target, "moment": self.moment, "signals": [s.name for s in self.signals]}
        found |= {"delay": round(self.delay, 3), "sent": sent, "code": code, "seconds": round(ended - self._sent_at, 2)}
        return found | {"outcome": self._outcome(), "wrong": self._wrong(code, ended, left) if sent else ""}

    @property
    def _may_go_on(self) -> bool:
        """Whether the target ignores the signals, because the process that it serves handles them."""
        return self.target == "engine" and not {signal.SIGTERM, signal.SIGQUIT} & set(self.signals)

    def _read(self, process: "subprocess.Popen[str]") -> None:
        assert process.stderr is not None
        self.errors.extend(iter(process.stderr.readline, ""))

    def _send(self, process: "subprocess.Popen[str]") -> bool:
        """Wait for the moment, and send the signals; return whether the process still existed."""
        self._pids: dict[str, int] = {}
        follows = {"engine": "engine", "bench": "bench"}.get(self.target, "")
        stage = self._chance.choice(("engine", "bench", "")) if self.target in ("terminal", "window") else follows
        self._until(process, lambda: "begun\n" in self.errors)
        until = {"transfer": self._transfers, "start": lambda: not stage or stage in self._pids}
        begun = until.get(self.moment, lambda: "bench" in self._pids and any(self._folder.rglob("SN-*.h5")))
        self._sent_at = time.time()
        if not self._until(process, begun):
            return False
        end = time.monotonic() + self.delay
        self._until(process, lambda: time.monotonic() > end)
        if process.poll() is not None:
            return False
        self._sent_at = time.time()
        for number, each in enumerate(self.signals):
            time.sleep(self.pause * number)
            with suppress(ProcessLookupError):
                if self.target in ("terminal", "window") and each != signal.SIGTERM:
                    os.killpg(process.pid, each)
                else:
                    os.kill(self._pids.get(self.target, process.pid), each)
        return True

    def _transfers(self) -> bool:
        return any("egister" in line for line in self.errors) or bool(list(self._folder.rglob("registers/*")))

    def _until(self, process: "subprocess.Popen[str]", is_reached: Callable[[], bool]) -> bool:
        """Wait until something is reached, and look for the processes of the run; return whether it was reached."""
        end = time.monotonic() + LONGEST
        while not is_reached():
            if process.poll() is not None or time.monotonic() > end:
                return False
            self._find(process.pid)
            time.sleep(0.005)
        self._find(process.pid)
        return True

    def _find(self, pid: int) -> None:
        if "bench" in self._pids:
            return
        for child in _children(pid):
            command = _command_line(child)
            if "spawn_main" in command and "engine" not in self._pids and self._is_engine(child):
                self._pids["engine"] = child
        for child in _children(self._pids.get("engine", 0)):
            if "calstation.bench" in _command_line(child):
                self._pids["bench"] = child

    def _is_engine(self, pid: int) -> bool:
        """Whether a spawned process is the engine; a window also has a worker, which never starts a bench."""
        return self.target != "window" or any("calstation.bench" in _command_line(child) for child in _children(pid))

    def _outcome(self) -> list[list[str | None]]:
        outcomes = list[list[str | None]]()
        for log in sorted(self._folder.rglob("SN-*.h5")):
            file = log.with_suffix(".json")
            result = json.loads(file.read_text("utf-8")) if file.exists() else {}
            outcomes.append([result.get("outcome"), open_log(log).outcome, result.get("error_code")])
        return outcomes

    def _has_moved(self) -> bool:
        return any(open_log(log).facts().samples for log in self._folder.rglob("SN-*.h5"))

    def _wrong(self, code: int | None, ended: float, left: list[str]) -> str:
        """Return what is wrong with the end of a trial."""
        text = "".join(self.errors)
        if code is None:
            return "hangs"
        if "Traceback" in text or "nternal error" in text:
            return "traceback"
        permitted = {"engine": (0, 4), "bench": (0, 3, 4), "window": (0, 4)}.get(self.target, (0, 4))
        if code not in permitted:
            return f"exit code {code}"
        if left:
            return f"{left} remain"
        if code == 0 and self.target in ("command", "terminal") and ended - self._sent_at > 15.0:
            return "the signal was ignored"
        outcomes = self._outcome()
        expected = {0: "passed", 3: "fault", 4: "stopped"}
        for pair in outcomes:
            if pair[0] != pair[1] or (self.target != "window" and pair[0] != expected[code]):
                return f"outcome {pair}"
        if code == 0 and self.target != "window" and not outcomes:
            return "nothing was recorded"
        output = self._folder / "out.json"
        if outcomes and self.target != "window" and not output.exists():
            return "no result"
        report = self._folder / "bench.json"
        if self.target == "bench" or "bench" not in self._pids:
            return ""
        if not report.exists():
            return "no report of the bench" if self._has_moved() else ""  # it was killed during its start
        state = json.loads(report.read_text("utf-8"))
        if state["enabled"] or state["moving"] or state["fault"] != "NONE":
            return f"table {state}"
        return "the command ended before the bench" if report.stat().st_mtime > ended else ""


def _restore_signals() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)  # in the background of a shell, some are ignored


def _children(pid: int) -> list[int]:
    with suppress(OSError):
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()] + [
            int(word)
            for task in Path(f"/proc/{pid}/task").iterdir()
            if task.name != str(pid)
            for word in (task / "children").read_text().split()
        ]
    return []


def _command_line(pid: int) -> str:
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode("utf-8", "replace").replace("\0", " ")
    return ""


def _alive(pid: int | None) -> bool:
    with suppress(OSError, ValueError):
        return pid is not None and Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def main(first: int, count: int, folder: Path, step: int = 1) -> int:
    """Run trials in order, print each and the summary; return the number of failures."""
    kinds, failures, sent = Counter[str](), 0, 0
    for seed in range(first, first + count, step):
        place = Path(tempfile.mkdtemp(prefix=f"{seed}-", dir=folder))
        trial = Trial(seed, place)
        found = trial.run()
        sent += found["sent"]
        kinds[f"{found['target']} {found['code']}"] += found["sent"]
        print(json.dumps({"seed": seed, **found}), flush=True)
        if found["wrong"]:
            failures += 1
            (place / "errors.txt").write_text("".join(trial.errors), "utf-8")
        else:
            shutil.rmtree(place)
    print(json.dumps({"sent": sent, "failures": failures, "ends": kinds}), flush=True)
    return failures


if __name__ == "__main__":
    sys.exit(min(1, main(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]), int((sys.argv[4:] or ["1"])[0]))))
