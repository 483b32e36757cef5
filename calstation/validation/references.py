"""Reference logs: transfer, solution against stored answers and true values, and the independent second opinion."""

import hashlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from calstation.config import library
from calstation.errors import InputError
from calstation.messages import Text
from calstation.parsing import read_json
from calstation.records import LogFacts, open_log, write_log
from calstation.results import Result, resolve_log, write_json
from calstation.validation.lines import CheckStopped, Line, guarded
from procedures import names

#: Answers in the folder of the reference logs.
ANSWERS = "answers.json"
#: Largest difference of a value in sigmas, and relative difference of a sigma: negligible, but larger than differences
#: in rounding between processors and versions of the libraries.
BOUND = 1e-3
#: Largest error of a value in sigmas; the true values of the simulated units are known.
TRUTH_BOUND = 5.0
#: Number of the reference logs.
REFERENCES = 5
_AREA = "calculation"


def references_folder() -> Path:
    """Return the folder of the shipped reference logs."""
    return library.shipped_folder() / "references"


def answer_of(csv: Path, truth: Mapping[str, float]) -> dict[str, Any]:
    """Return the answer of a reference log as JSON data; `truth` has the true values by parameter, SI."""
    with tempfile.TemporaryDirectory() as temporary:
        raw = Path(temporary) / "log.h5"
        _, digest = _import(csv, raw)
        result = _solve(raw, lambda: None)
    known = {name: float(truth[name]) for name in result.parameters if name in truth}
    return {"samples_sha256": digest, "truth": known, **_answer(result)}


def _answer(result: Result) -> dict[str, Any]:
    parameters = {name: [row.value, row.sigma] for name, row in result.parameters.items()}
    return {"stages": list(result.stages), "passed": result.passed, "parameters": parameters}


def _import(csv: Path, raw: Path) -> tuple[LogFacts, str]:
    """Import a CSV as a raw log; return its facts, and the digest of the samples read back from it."""
    source = open_log(csv)
    write_log(raw, source.meta, source.blocks())
    log, digest = open_log(raw), hashlib.sha256()
    for block in log.blocks():
        for column in (block.seq, block.time, block.counts, block.angles, block.step, block.others, block.joints):
            digest.update(column.astype("<f8").tobytes())
    return log.facts(), digest.hexdigest()


def _solve(raw: Path, check_stopped: CheckStopped, *, diagnostics: bool = True) -> Result:
    log = open_log(raw)
    return resolve_log(log, log.meta, progress=lambda *_: check_stopped(), diagnostics=diagnostics).result


def reference_lines(check_stopped: CheckStopped) -> Generator[Line]:
    """Solve every reference log that is shipped, and name the methods without one."""
    folder = references_folder()
    try:
        answers: dict[str, dict[str, Any]] = read_json(folder / ANSWERS)
        covered = {stage for answer in answers.values() for stage in answer["stages"]}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        yield Line.compared(_AREA, "answers", ANSWERS, Text("validation.present"), Text("validation.missing"), False)
        return
    count = str(len(answers))
    yield Line.compared(_AREA, "answers", ANSWERS, str(REFERENCES), count, count == str(REFERENCES))
    for name, answer in answers.items():
        yield from guarded(_AREA, "solution", name, partial(_lines, folder, name, answer, check_stopped))
    for name in names():
        if name not in covered:
            reason = Text("validation.no_reference")
            yield Line.unchecked(_AREA, "solution", name, "", reason, required=False)


def _lines(folder: Path, name: str, answer: dict[str, Any], check_stopped: CheckStopped) -> Generator[Line]:
    with tempfile.TemporaryDirectory(prefix="calstation-validate-") as temporary:
        raw = Path(temporary) / f"{name}.h5"
        facts, digest = _import(folder / f"{name}.csv.gz", raw)
        expected = answer["samples_sha256"]
        yield Line.compared(_AREA, "transfer", name, expected[:16], digest[:16], digest == expected)
        result = _solve(raw, check_stopped)
        begin = time.monotonic()
        again = _solve(raw, check_stopped, diagnostics=False)
        seconds = time.monotonic() - begin
        try:
            yield from _compared(name, result, again, answer)
        except (KeyError, TypeError, ValueError, ZeroDivisionError) as exc:
            raise InputError("validation.answer_damaged", file=folder / ANSWERS, name=name) from exc
        yield from _second_opinion(name, raw, result, bool(answer.get("second_opinion")), check_stopped)
        duration = facts.samples / open_log(raw).meta.imu.sample_rate_hz
        yield Line.timed("time", "solving", name, seconds, round(duration))


def _compared(name: str, result: Result, again: Result, answer: dict[str, Any]) -> Generator[Line]:
    solved, stored = _answer(result)["parameters"], answer["parameters"]
    good = set(solved) == set(stored) and result.passed == answer["passed"]
    value = _largest((solved[n][0] - stored[n][0]) / stored[n][1] for n in stored if n in solved)
    sigma = _largest(solved[n][1] / stored[n][1] - 1.0 for n in stored if n in solved)
    good = good and value <= BOUND and sigma <= BOUND
    bits = Text("validation.bits") if solved == stored else Text("validation.other_bits")
    text = Text.of(
        "validation.difference", bits=bits, value=f"{value:.1e}", sigma=f"{sigma:.1e}", digest=_digest(solved)
    )
    expected = Text.of("validation.within", bound=f"{BOUND:g}", count=len(stored))
    yield Line.compared(_AREA, "solution", name, expected, text, good)
    same = _answer(again)["parameters"] == solved
    bits = Text("validation.bits" if same else "validation.other_bits")
    yield Line.compared(_AREA, "repetition", name, Text("validation.bits"), bits, same)
    truth = answer["truth"]
    if not truth:
        yield Line.unchecked(_AREA, "truth", name, "", Text("validation.no_truth"))
        return
    error = _largest((solved[n][0] - truth[n]) / solved[n][1] for n in truth)
    limit = Text.of("validation.truth_within", bound=f"{TRUTH_BOUND:g}", count=len(truth))
    yield Line.compared(_AREA, "truth", name, limit, f"{error:.2f} σ", error <= TRUTH_BOUND)


def _largest(values: Iterable[float]) -> float:
    """Return the largest magnitude, NaN if any value is NaN, 0 without values."""
    return float(np.max(np.abs(list(values)), initial=0.0))


def _digest(parameters: Mapping[str, list[float]]) -> str:
    return hashlib.sha256(json.dumps(parameters, sort_keys=True).encode()).hexdigest()[:16]


def _second_opinion(
    name: str, raw: Path, result: Result, covered: bool, check_stopped: CheckStopped
) -> Generator[Line]:
    """Compare a result with that of the independent program, ``calstation verify``."""
    expected = Text("validation.agrees")
    if not covered:
        reason = Text("validation.not_covered")
        yield Line.unchecked(_AREA, "second_opinion", name, expected, reason, required=False)
        return
    file = raw.with_suffix(".json")
    write_json(file, result.to_json())
    command = [sys.executable, "-m", "calstation", "verify", str(file), "--log", str(raw), "--json", "-"]
    report = _run(command, check_stopped)
    try:
        comparison = json.loads(report.stdout)
        differences = [abs(row["difference"]) for row in comparison["parameters"].values()]
    except (ValueError, KeyError, TypeError, AttributeError):
        differences = []
    values = {"value": f"{max(differences, default=0.0):.3f}", "count": len(differences), "code": report.returncode}
    found = Text("validation.verified", values)
    good = report.returncode == 0 and bool(differences)
    yield Line.compared(_AREA, "second_opinion", name, expected, found, good)


def _run(command: list[str], check_stopped: CheckStopped) -> "subprocess.CompletedProcess[str]":
    """Run a command that can be stopped."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        while True:
            try:
                output, _ = process.communicate(timeout=0.2)
                return subprocess.CompletedProcess(command, process.returncode, output)
            except subprocess.TimeoutExpired:
                try:
                    check_stopped()
                except BaseException:
                    process.kill()
                    raise
