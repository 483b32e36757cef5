"""`calstation quality` on a synthetic history: tables, JSON, and a gauge study from plan to verdict."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from calstation.config import library
from calstation.physics import NAMES
from calstation.quality import StudyState
from tests.cli.conftest import Done
from tests.synthetic.run_history import synthesise_runs
from tests.synthetic.test_run_history import ignore

Run = Callable[..., Done]
RUNS = 700


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic history."""
    folder = tmp_path_factory.mktemp("site") / "runs"
    synthesise_runs(ignore, folder, RUNS, 2)
    return folder


@pytest.mark.long
def test_tables_show_yield_failed_checks_and_charts_of_every_product(calstation: Run, folder: Path) -> None:
    done = calstation("quality", "--out", folder)
    assert done.code == 0
    for text in (
        "passed in the first run",
        "bench 3",
        "Wang Fang",
        "failed checks",
        "Tactical grade B",
        "CUSUM",
        "Ppk",
    ):
        assert text in done.out
    assert done.out.count("gyro_bias_x ") >= 3
    assert "…" not in done.out  # nothing is cut off


def test_every_option_has_a_default(calstation: Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder.parent)
    done = calstation("quality")
    assert done.code == 0, done.err
    assert "passed in the first run" in done.out


def test_parameter_of_a_product_since_a_date_is_written_as_json(calstation: Run, folder: Path) -> None:
    options = ("--product", "nav_a", "--parameter", "accel_scale_x", "--since", "2026-05-01")
    found = calstation("quality", "--out", folder, *options, "--json", "-").json
    assert (found["schema"], found["product"], found["golden"]) == ("calstation.quality/1", "Navigation grade A", None)
    (row,) = found["parameters"]
    assert (row["parameter"], row["capability"]["low"], row["capability"]["high"]) == ("accel_scale_x", -9e-4, 9e-4)
    assert set(found["yield"]) == {
        *("overall", "units", "first_pass", "days", "products", "stations", "operators", "failed_checks"),
        *("partial_failed", "missing"),
    }
    days = found["yield"]["days"]
    assert min(days) >= "2026-05-01"
    assert sum(day["count"] for day in days.values()) == found["yield"]["overall"]["count"]


def test_added_and_removed_runs_are_counted(calstation: Run, folder: Path, tmp_path: Path) -> None:
    """A run counts also after its files were removed, so that removing them does not raise the yield."""

    def count() -> tuple[int, int]:
        found = calstation("quality", "--out", tmp_path, "--json", "-").json["yield"]
        return found["overall"]["count"], found["missing"]

    first, second = sorted(folder.glob("NAVA-*.json"))[:2]
    shutil.copy2(first, tmp_path)
    assert count() == (1, 0)
    shutil.copy2(second, tmp_path)
    assert count() == (2, 0)
    (tmp_path / first.name).unlink()
    assert count() == (2, 1)


@pytest.mark.parametrize(
    ("real", "said"),
    [(0, "All runs are simulated, of the virtual bench."), (1, "2 simulated runs of the virtual bench left out.")],
)
def test_simulated_runs_are_left_out_unless_all_are_simulated(
    calstation: Run, folder: Path, tmp_path: Path, real: int, said: str
) -> None:
    for k, file in enumerate(sorted(folder.glob("NAVA-*.json"))[: real + 2]):
        content = json.loads(file.read_text(encoding="utf-8"))
        (tmp_path / file.name).write_text(json.dumps({**content, "simulated": k >= real}), encoding="utf-8")
    assert said in calstation("quality", "--out", tmp_path).out
    found = calstation("quality", "--out", tmp_path, "--json", "-").json
    assert found["simulated"] == {"left_out": 2 if real else 0, "only": not real}
    assert found["yield"]["overall"]["count"] == (real or 2)


def test_check_standard_has_its_own_table(calstation: Run, folder: Path) -> None:
    done = calstation("quality", "--out", folder, "--serial", "GOLDEN-NAVA", "--product", "nav_a")
    runs = len([*folder.glob("GOLDEN-NAVA_*.json")])
    assert runs < 10
    assert "Check standard GOLDEN-NAVA: fewer than 10 runs" in done.out


def test_unit_without_runs_is_reported(calstation: Run, folder: Path) -> None:
    done = calstation("quality", "--out", folder, "--serial", "NOPE")
    assert done.code == 0
    assert f"There is no run of unit NOPE in {folder}. Check the serial number" in done.out
    assert "fewer than 10" not in done.out


def test_folder_without_judged_runs_is_reported(calstation: Run, tmp_path: Path) -> None:
    assert "No run ended with PASS or FAIL." in calstation("quality", "--out", tmp_path).out
    assert calstation("quality", "--out", tmp_path, "--json", "-").json["yield"]["overall"] is None


@pytest.mark.parametrize(
    ("options", "shown"),
    [
        (("--out", "nowhere"), "nowhere: No such folder of runs"),
        (("--parameter", "gyro_bias"), "--parameter 'gyro_bias' is unknown"),
        (("--since", "yesterday"), "--since yesterday: must be a date such as 2026-11-23."),
        (("gauge", "none.json"), "none.json"),
        (("--product", "mems_c", "standards"), "--product stands before 'standards' and would be ignored. Write it"),
        (("--out", "nowhere", "gauge", "p.json"), "calstation quality gauge --out …"),
        (
            ("gauge", "p.json", "--plan", "--units", "A,B", "--operators", "x,y"),
            "The plan names no product",
        ),
        (("gauge", "p.json", "--plan", "--product", "nav_a", "--units", "A", "--stations", "x,y"), "two units: 1"),
        (("gauge", "p.json", "--plan", "--product", "nav_a", "--units", "A,B"), "neither operators nor stations"),
        (
            ("gauge", "no/p.json", "--plan", "--product", "nav_a", "--units", "A,B", "--operators", "x,y"),
            "cannot be written",
        ),
    ],
)
def test_wrong_options_are_refused(
    calstation: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], shown: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    done = calstation("quality", *options)
    assert done.code == 2
    assert shown in done.err


@pytest.mark.long
def test_gauge_study_is_planned_and_evaluated_from_stored_runs(calstation: Run, folder: Path, tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    units = ("--product", "nav_a", "--units", "STUDY-01, STUDY-02")
    options = (*units, "--operators", "Li Wei,Zhang Min", "--trials", 2, "--seed", 5)
    shown = calstation("quality", "gauge", plan, "--plan", *options)
    assert shown.code == 0
    assert "8 runs" in " ".join(shown.out.split())
    order = json.loads(plan.read_text())["order"]
    assert [row["trial"] for row in order] == [1] * 4 + [2] * 4
    incomplete = calstation("quality", "gauge", plan, "--out", folder)
    assert incomplete.code == 2
    next_run = f"next: {order[0]['unit']}, {order[0]['operator']}"
    assert f"8 of the 8 runs of the study missing; {next_run}" in incomplete.err

    copied = tmp_path / "simulated"
    shutil.copytree(folder, copied, ignore=shutil.ignore_patterns("*.sqlite*"))
    for file in copied.glob("STUDY-*.json"):
        file.write_text(json.dumps({**json.loads(file.read_text(encoding="utf-8")), "simulated": True}))
    evaluate = "quality", "gauge", copied / "studies" / "gauge.json", "--out", copied
    simulated = calstation(*evaluate)
    assert simulated.code == 0, "real runs that are not of the study do not matter"
    assert "All runs are simulated, of the virtual bench." in simulated.out
    first = min(copied.glob("STUDY-*.json"))
    first.write_text(json.dumps({**json.loads(first.read_text(encoding="utf-8")), "simulated": False}))
    for index in copied.glob("*.sqlite*"):
        index.unlink()
    left_out = calstation(*evaluate)
    assert left_out.code == 2, "simulated runs do not count beside real ones of the study"
    assert "89 simulated runs of the virtual bench left out." in left_out.out

    done = calstation("quality", "gauge", folder / "studies" / "gauge.json", "--out", folder)
    assert done.code == 0
    assert "Navigation grade A, 10 units, 3 operators, 3 trials" in done.out
    assert "planned order" not in done.out
    assert "acceptable" in done.out
    assert "…" not in done.out
    study = ("quality", "gauge", folder / "studies" / "gauge.json", "--out", folder, "--json", "-")
    found = calstation(*study).json["parameters"]
    assert [*found] == [*NAMES]
    assert found["gyro_bias_x"]["gauge"]["percent_tolerance"] < 30.0, "the limits of the plan's product apply"
    assert set(found["gyro_bias_x"]["components"]) >= {"unit", "operator"}
    assert found["gyro_bias_x"]["categories"] > 5
    refused = calstation(*study, "--product", "mems_c")
    assert (refused.code, "its plan is for 'Navigation grade A'" in refused.err) == (2, True)
    assert calstation(*study).json["out_of_order"] == 0
    other = calstation(*study, "--parameter", "clock_offset")
    assert (other.code, "not every run of the study solved the parameter" in other.err.lower()) == (2, True)
    assert [*calstation(*study, "--parameter", "gyro_bias_y").json["parameters"]] == ["gyro_bias_y"]


def test_gauge_study_names_parameters_whose_ranges_are_not_in_control(
    calstation: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = ("quality", "gauge", folder / "studies" / "gauge.json", "--out", folder)
    monkeypatch.setattr(StudyState, "beyond", lambda _, name: 2 * (name == "gyro_bias_y"))
    assert "gyro_bias_y: Ranges beyond the control limits: 2." in calstation(*study).out
    rows = calstation(*study, "--json", "-").json["parameters"]
    assert [name for name, row in rows.items() if row["ranges_beyond"]] == ["gyro_bias_y"]


@pytest.mark.parametrize(
    ("code", "words"), [("en", "Station 'virtual bench'; choose"), ("zh_CN", "工位“virtual bench”；用 --station")]
)
def test_standards_name_the_station_that_was_not_given(
    calstation: Run, folder: Path, monkeypatch: pytest.MonkeyPatch, code: str, words: str
) -> None:
    monkeypatch.setattr("calstation.cli.text.LANGUAGE", code)
    assert words in calstation("quality", "standards", "--out", folder).out
    station = library.find("stations", "virtual_bench")
    assert words not in calstation("quality", "standards", "--out", folder, "--station", station).out
