"""The designer finds schedules that meet the limits and run on the virtual bench, and refuses unreachable limits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calstation.config import RunRequest, check, library, load_configuration, load_product, read_text
from calstation.designer import DesignRequest, design_schedule, designed_product, shorten_stages, shorter_product
from calstation.designer.designer import _Designer
from calstation.designer.search import Stop
from calstation.errors import ConfigurationError
from calstation.physics import NAMES
from calstation.results import compute_preview
from calstation.runs import execute, run_summary
from calstation.sequencer import Control, Finalized, StageEnded, table_task
from tests.gui import design_jobs
from tests.helpers import raises_code


def ignore(fraction, remaining_s=None, note=""):
    assert 0.0 <= fraction <= 1.0


@pytest.fixture(scope="module")
def fractions():
    """The fractions that the design `mems` reports."""
    return []


@pytest.fixture(scope="module")
def mems(fractions):
    """A design from a short search."""

    def report(fraction, remaining_s=None, note=""):
        fractions.append(fraction)

    return design_schedule(report, DesignRequest(product=library.find("products", "mems_c"), time_limit=1.0))


def changed(tmp_path: Path, kind: str, name: str, *changes: tuple[str, str]) -> Path:
    """Return a copy of a shipped file with replaced text."""
    text = read_text(library.find(kind, name))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / kind / f"{name}_changed.toml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.long
def test_designed_schedule_meets_the_limits_with_margin_under_all_conditions(mems):
    assert mems.worst <= mems.margin * 1.001
    assert mems.sigma[NAMES.index(mems.limiting)] == pytest.approx(mems.worst * mems.limits[NAMES.index(mems.limiting)])
    assert 1 < mems.planned <= len(mems.moves)
    assert mems.duration < mems.longest < mems.present
    assert {v.name for v in mems.variations} == {"mounting", "heading", "noise"}
    assert all(v.duration is not None and v.worst <= 1.0 for v in mems.variations)
    assert max(abs(angle) for outer, inner, _ in mems.moves for angle in (outer, inner)) <= 360.0
    assert sum(rest >= mems.gravity_rest for rest in mems.rests) >= 3


def test_duration_of_a_run_is_planned_with_the_designed_moves(tmp_path):
    product, designed = library.find("products", "mems_c"), design_jobs.design()
    path = tmp_path / "designed.toml"
    path.write_text(designed_product(read_text(product), designed), encoding="utf-8")
    (plan,) = table_task(load_configuration(RunRequest("M-1", None, path))).stages
    assert plan.rule.usual == designed.planned < len(designed.moves)


@pytest.mark.long
def test_planned_duration_of_a_run_is_that_of_the_design(tmp_path, mems):
    path = tmp_path / "designed.toml"
    path.write_text(designed_product(read_text(library.find("products", "mems_c")), mems), encoding="utf-8")
    request = RunRequest("M-1", None, path, out=tmp_path / "runs")
    (stage,), (previewed,) = run_summary(request).stages, compute_preview(ignore, request).stages
    assert stage.duration == pytest.approx(mems.duration, abs=0.1)
    assert (previewed.moves, previewed.end) == (mems.planned, pytest.approx(mems.duration, abs=0.1))


@pytest.mark.long
def test_progress_continues_after_the_search(mems, fractions):
    """The reserve and the verification take as long as a short search."""
    assert fractions == sorted(fractions)
    assert 0.0 == fractions[0] <= fractions[-1] < 1.0
    steps = sorted({fraction for fraction in fractions if fraction >= 0.9})
    assert len(steps) > 2 * len(mems.variations)
    assert max(np.diff(steps)) < 0.02


def test_front_of_a_search_contains_complete_schedules(monkeypatch):
    designer = _Designer(ignore, DesignRequest(product=library.find("products", "mems_c"), time_limit=1.0))
    designer._front.add(5.0, 0.7, (Stop((0, 0), 3), Stop((1, 0), 1)))
    ((seconds, worst, _),) = designer._complete_front(100.0, 0.79).points()
    assert seconds > 10.0, "with the long rests of the gravity check"
    assert worst > designer._margin
    monkeypatch.setattr(designer, "_worst", lambda *_: 0.7)
    assert designer._complete_front(100.0, 0.6).points() == [], "it would seem to reach the limits earlier"
    designer._request = replace(designer._request, duration=100.0)
    assert designer._complete_front(100.0, 0.75).points() == [], "it would seem better in the same time"
    assert len(designer._complete_front(100.0, 0.65).points()) == 1


@pytest.mark.long
def test_json_uses_the_names_of_the_public_interface(mems):
    shown = mems.to_json()
    assert shown["duration_s"] == mems.duration
    assert shown["moves"] == [list(move) for move in mems.moves]
    assert {"worst_sigma_over_limit", "default_duration_s"} <= set(shown)
    assert {row["cause"] for row in shown["hidden"]} >= {"accel_cubic", "gyro_asymmetry", "drift_throughout"}


def test_product_with_the_designed_schedule_is_valid(mems):
    text = designed_product(read_text(library.find("products", "mems_c")), mems)
    assert check("products", text) == []
    assert 'stages = ["designed"]' in text
    assert "improvement_at_rest" not in text


@pytest.mark.long
def test_design_determines_the_parameters_for_which_the_product_has_no_limit(tmp_path):
    limit = "[limits.accel_quadratic] # s²/m\nwithin = 1.8e-05\nsigma_below = 8.0e-06\n"
    product = changed(tmp_path, "products", "mems_c", (limit, ""), ("sigma_below = 0.0001", "sigma_below = 0.001"))
    result = design_schedule(ignore, DesignRequest(product=product, time_limit=1.0))
    assert result.undetermined == ()
    i = NAMES.index("accel_quadratic_x")
    assert result.limits[i] == np.inf
    path = tmp_path / "designed.toml"
    path.write_text(designed_product(read_text(product), result), encoding="utf-8")
    preview = compute_preview(ignore, RunRequest("M-1", None, path, out=tmp_path / "runs"))
    assert preview.undetermined == ()


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        (
            (("sigma_below = 1.9e-05\nsigma_below_after", "sigma_below = 1.9e-08\nsigma_below_after"),),
            "design.unreachable",
        ),
        ((("sigma_below = 0.0001", "sigma_below = 1e-7"),), "design.gravity"),
    ],
)
def test_unreachable_limit_is_reported_with_the_smallest_possible_sigma(tmp_path, changes, code):
    product = changed(tmp_path, "products", "mems_c", *changes)
    with raises_code(ConfigurationError, code) as raised:
        design_schedule(ignore, DesignRequest(product=product, time_limit=1.0))
    values = raised.value.values
    assert values["least"] > 0.8 * values["limit"]
    assert values["parameter"].startswith("gyro_bias" if code == "design.unreachable" else "accel_scale")


@pytest.mark.exhaustive
def test_search_starts_with_the_moves_of_a_designed_stage_which_reveal_what_the_product_requires():
    path = library.find("products", "mems_c_fast")
    result = design_schedule(ignore, DesignRequest(product=path, time_limit=1.0))
    moves = load_product(path)[1].schedule["designed"]["moves"]
    assert result.searched
    assert result.planned == 12
    assert [list(move) for move in result.moves[:11]] == moves[:11]
    drift = next(h for h in result.hidden if h.parameter.startswith("gyro_scale"))
    i = NAMES.index(drift.moved)
    assert drift.move * result.sigma[i] < 1.1 * result.limits[i]


@pytest.mark.long
@pytest.mark.parametrize(
    "table",
    [
        pytest.param(
            (("low_deg = -1080.0", "low_deg = -170.0"), ("high_deg = 1080.0", "high_deg = 170.0")), id="short"
        ),
        pytest.param(
            (
                ("max_rate_dps = 120.0", "max_rate_dps = 20.0"),
                ("max_acceleration_dps2 = 200.0", "max_acceleration_dps2 = 20.0"),
            ),
            id="slow",
            marks=pytest.mark.exhaustive,
        ),
        pytest.param(
            (("inner_axis = [0.0, 0.0, 1.0]", "inner_axis = [0.0, 0.6, 0.8]"),),
            id="oblique inner axis",
            marks=pytest.mark.exhaustive,
        ),
    ],
)
def test_schedules_for_other_tables_run_on_the_bench(tmp_path, monkeypatch, table):
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    changed(tmp_path, "tables", "bench", *table)
    station = changed(tmp_path, "stations", "virtual_bench", ('profile = "bench"', 'profile = "bench_changed"'))
    shipped = library.find("products", "mems_c")
    output = design_schedule(ignore, DesignRequest(station, shipped, time_limit=1.0))
    product = tmp_path / "product.toml"
    product.write_text(designed_product(read_text(shipped), output), encoding="utf-8")
    events: list[object] = []
    execute(RunRequest("M-1", station, product, out=tmp_path / "runs"), events.append, Control())
    ended = events[-1]
    assert isinstance(ended, Finalized)
    assert ended.verdict.passed, [c for c in ended.result["checks"] if not c["passed"]]
    (stage,) = (e for e in events if isinstance(e, StageEnded))
    assert stage.reason == "targets"


@pytest.mark.exhaustive
def test_longer_duration_gives_smaller_sigmas():
    product = library.find("products", "mems_c")
    short, long = (
        design_schedule(ignore, DesignRequest(product=product, duration=d, time_limit=1.0)) for d in (15.0, 30.0)
    )
    assert short.duration <= 15.5
    assert long.duration <= 30.5
    assert long.worst < short.worst
    assert long.schedule()["stop_at_limits"] is False


@pytest.mark.exhaustive
def test_stages_of_a_product_are_shortened_within_its_limits():
    product = library.find("products", "mems_c")
    output = shorten_stages(ignore, DesignRequest(product=product))
    assert output.duration < 0.5 * output.present
    assert output.worst <= 0.8
    assert np.isfinite(output.sigma).all()
    assert check("products", shorter_product(read_text(product), output)) == []
