"""The `resolve`, `import` and `export` commands."""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.conftest import HEADER, META, Done, six_position_rows, write_log


def test_resolve_shows_a_table(calstation: Callable[..., Done], tmp_path: Path) -> None:
    done = calstation("resolve", write_log(tmp_path, six_position_rows()))
    assert done.code == 0, done.err
    assert "accel_scale_x" in done.out
    assert "ppm" in done.out


def test_json_output_contains_nothing_else(calstation: Callable[..., Done], tmp_path: Path) -> None:
    done = calstation("resolve", write_log(tmp_path, six_position_rows()), "--json", "-")
    assert done.code == 0
    assert done.json["schema"] == "calstation.result/1"
    assert done.json["passed"] is None
    assert done.json["outcome"] == "resolved"
    assert done.json["unit"]["serial"] == "SN-7"
    assert abs(done.json["parameters"]["accel_scale_x"]["value"]) < 1e-3


def test_parameters_only_solution_is_not_judged(calstation: Callable[..., Done], tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    done = calstation("resolve", log, "--parameters-only")
    assert done.code == 0, done.err
    assert "accel_scale_x" in done.out
    assert "Parameters only: not judged, since data and model were not tested." in done.out
    alone = calstation("resolve", log, "--parameters-only", "--json", "-").json
    full = calstation("resolve", log, "--json", "-").json
    assert (alone["tested"], alone["passed"], alone["checks"]) == (False, None, [])
    assert alone["parameters"] == full["parameters"]
    done = calstation("resolve", log, "--parameters-only", "--residuals")
    assert done.code == 2
    assert "--residuals needs the full solution" in done.err


def test_solution_is_recorded_or_the_reason_is_shown(calstation: Callable[..., Done], tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    assert calstation("resolve", log, "--from", 10).code == 0
    (record,) = map(json.loads, (tmp_path / "resolves.jsonl").read_text("utf-8").splitlines())
    assert (record["log"], record["first_seq"], record["stages"]) == (log.name, 10, ["six_position"])
    (tmp_path / "resolves.jsonl").unlink()
    (tmp_path / "resolves.jsonl").mkdir()
    done = calstation("resolve", log)
    assert done.code == 0
    assert "The solution is not recorded" in done.err
    assert "accel_scale_x" in done.out


def test_json_is_written_to_a_file(calstation: Callable[..., Done], tmp_path: Path) -> None:
    target = tmp_path / "result.json"
    assert calstation("resolve", write_log(tmp_path, six_position_rows()), "--json", target).code == 0
    assert json.loads(target.read_text(encoding="utf-8"))["stages"] == ["six_position"]


def test_imported_and_exported_logs_give_the_same_solution(calstation: Callable[..., Done], tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    assert calstation("import", log, "-o", tmp_path / "log.h5").code == 0
    assert calstation("export", tmp_path / "log.h5", "-o", tmp_path / "again.csv").code == 0
    answers = [
        calstation("resolve", tmp_path / name, "--json", "-").json["parameters"]
        for name in ("log.csv", "log.h5", "again.csv")
    ]
    assert answers[0] == answers[1] == answers[2]


def test_part_of_a_log_is_solved(calstation: Callable[..., Done], tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows(10.0))
    done = calstation("resolve", log, "--from", 100, "--to", 2900, "--json", "-")
    assert done.code == 0, done.err
    assert (done.json["log"]["first_seq"], done.json["log"]["last_seq"]) == (100, 2900)
    assert done.json["duration_s"] == pytest.approx(2801 / 50.0)


def test_temperatures_of_a_part_are_those_of_its_samples(calstation: Callable[..., Done], tmp_path: Path) -> None:
    rows = [f"{row},{20.0 + k / 100}" for k, row in enumerate(six_position_rows(10.0))]
    log = write_log(tmp_path, rows)
    log.write_text(log.read_text("utf-8").replace(HEADER, f"{HEADER},temp_c"), encoding="utf-8")
    whole, part = (
        calstation("resolve", log, *span, "--json", "-").json for span in ((), ("--from", 100, "--to", 2900))
    )
    assert (whole["temperature_c"]["min"], whole["temperature_c"]["max"]) == (20.0, 20.0 + (len(rows) - 1) / 100)
    assert (part["temperature_c"]["min"], part["temperature_c"]["max"]) == (21.0, 49.0)
    assert part["log"]["sha256"] == whole["log"]["sha256"]


def test_a_solution_of_a_part_of_a_log_is_shown_with_its_range(calstation: Callable[..., Done], tmp_path: Path) -> None:
    log, part, whole = write_log(tmp_path, six_position_rows(10.0)), tmp_path / "part.json", tmp_path / "whole.json"
    assert calstation("resolve", log, "--from", 100, "--to", 2900, "--json", part).code == 0
    assert calstation("show", part).out.rstrip().endswith("solved offline from samples 100 to 2900")
    assert calstation("resolve", log, "--from", 0, "--json", whole).code == 0
    assert calstation("show", whole).out.rstrip().endswith("solved offline")
    assert "part" not in json.loads(whole.read_text("utf-8"))["log"]


def test_truncated_stage_is_reported_and_earlier_stages_are_solved(
    calstation: Callable[..., Done], tmp_path: Path
) -> None:
    rows = six_position_rows()
    cut = [
        ",".join([str(number), f"{(number + 1) / 50:.2f}", *row.split(",")[2:10], "rate", "0"])
        for number, row in enumerate(rows[:200], start=len(rows))
    ]
    log = write_log(tmp_path, [*rows, *cut])
    done = calstation("resolve", log, "--json", "-")
    assert done.code == 2
    assert (done.json["stages"], list(done.json["lacking"])) == (["six_position"], ["rate"])
    assert "No whole turn about +x" in done.err
    assert done.err.rstrip().endswith("solved without it, as with --stages six_position.")
    done = calstation("resolve", log)
    assert "Not every stage of the log could be solved." in done.out
    assert calstation("resolve", log, "--stages", "six_position").code == 0


def test_improvement_is_relative_to_the_output_without_registers(
    calstation: Callable[..., Done], tmp_path: Path
) -> None:
    checks = '[product]\nname = "p"\n[product.checks.improvement_at_rest]\nbelow = 0.5\n'
    registers = "[registers]\n" + "".join(f"accel_scale_{axis} = 1e-3\n" for axis in "xyz")
    improvements = []
    for meta in (META.replace("accel_lsb = 1e-6", "accel_lsb = 1.001e-6") + checks, META + registers + checks):
        result = calstation("resolve", write_log(tmp_path, six_position_rows(), meta=meta), "--json", "-").json
        improvements += [c["value"] for c in result["checks"] if c["name"] == "improvement_at_rest"]
    assert improvements[0] < 0.1
    assert improvements[1] == pytest.approx(improvements[0], rel=0.01)


def test_debug_shows_a_traceback(calstation: Callable[..., Done], tmp_path: Path) -> None:
    done = calstation("resolve", tmp_path / "none.csv", "--debug")
    assert done.code == 2
    assert "Traceback" in done.err


@pytest.mark.long
def test_help_is_shown_without_delay() -> None:
    """It takes at most about twice the import time of the parser and the console."""
    commands = (["-m", "calstation", "--help"], ["-c", "import typer, rich.console"])
    output = ""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(3):
        for command, taken in zip(commands, times, strict=True):
            begin = time.perf_counter()
            done = subprocess.run([sys.executable, *command], capture_output=True, text=True, check=True)
            taken.append(time.perf_counter() - begin)
            output = output or done.stdout
    assert all(name in output for name in ("run", "resolve", "import", "export", "study"))
    assert min(times[0]) < 5.0 * min(times[1])


#: Modules that a command must not load.
UNUSED = {
    "--help": {"numpy", "numba", "h5py", "pydantic", "rich", "importlib.metadata", "calstation.config"},
    "resolve": {
        *("PySide6", "sqlalchemy", "pymodbus", "asyncio", "typst", "lxml", "allantools", "scipy.stats"),
        *("calstation.gui", "calstation.simulation", "calstation.bench", "calstation.connection", "calstation.runs"),
        *("calstation.database", "calstation.reports", "calstation.designer", "calstation.fleet", "calstation.quality"),
    },
}


@pytest.mark.long
@pytest.mark.parametrize("command", UNUSED)
def test_command_loads_only_what_it_needs(command: str, tmp_path: Path) -> None:
    arguments = [command] if command == "--help" else [command, str(write_log(tmp_path, six_position_rows()))]
    script = (
        "import sys; from calstation.cli.app import run_app\n"
        f"code = run_app({arguments}); print('loaded', *sys.modules); sys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    loaded = done.stdout.partition("loaded ")[2].split()
    assert "typer" in loaded
    assert sorted(UNUSED[command].intersection(loaded)) == []
