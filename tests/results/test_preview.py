"""What a preview promises: the run's own sigmas, its time, and every limit of the table that a plan breaks."""

from dataclasses import replace

import numpy as np
import pytest

from calstation.errors import ConfigurationError
from calstation.estimation.common.planned import profile
from calstation.messages.rendering import sentence
from calstation.physics.parameters import INDEX
from calstation.results.preview import MOST_ROUNDS, Preview, compute_preview
from calstation.sequencer.events import StageStarted
from tests.site_folder import PRODUCT, QUICK, SiteFolder


class Told:
    """A `ProgressCallback` that remembers."""

    def __init__(self) -> None:
        self.fractions: list[float] = []
        self.notes: list[str] = []

    def __call__(self, fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        self.fractions.append(fraction)
        self.notes.append(note)


def foretold(site_folder: SiteFolder, *stages: str, **schedule: dict[str, object]) -> Preview:
    """The forecast of these stages, with departures from the product's schedule by stage."""
    return compute_preview(Told(), replace(site_folder.request(*stages), schedule=schedule))


@pytest.mark.long
def test_the_sigmas_foretold_are_those_that_the_run_reports(site_folder: SiteFolder) -> None:
    told = compute_preview(Told(), site_folder.request())
    result = site_folder.run().result
    assert [s.stage for s in told.stages] == result["stages"]
    assert len(result["parameters"]) == 30
    final = told.stages[-1].sigma
    assert final is not None
    for name, parameter in result["parameters"].items():
        assert final[INDEX[name]] == pytest.approx(parameter["sigma"], rel=0.1), name
    for stage, started in zip(told.stages, site_folder.events_of(StageStarted), strict=True):
        assert stage.end - stage.begin == pytest.approx(started.duration, abs=5.0)


def test_a_stage_alone_counts_what_other_stages_would_have_told(site_folder: SiteFolder) -> None:
    alone, after = foretold(site_folder, "azimuth_flip"), foretold(site_folder, "excitation", "azimuth_flip")
    i = INDEX["gyro_bias_x"]
    assert alone.stages[0].sigma is not None
    assert after.stages[1].sigma is not None
    assert after.stages[1].sigma[i] < alone.stages[0].sigma[i] < alone.before[i]
    scale = INDEX["gyro_scale_x"]
    assert alone.stages[0].sigma[scale] == alone.before[scale]
    assert after.stages[0].observability["states"]["gyro_scale_x"]["step"] is not None


def test_the_course_keeps_to_the_plan(site_folder: SiteFolder) -> None:
    told = foretold(site_folder, "rate", "six_position")
    rate, six = told.stages
    assert (rate.begin, six.begin, six.end) == (0.0, rate.end, told.duration)
    assert rate.moves == 9
    assert six.moves == 6
    assert np.all(np.diff(told.time) >= -1e-9)
    assert told.time[-1] == pytest.approx(told.duration)
    assert np.ptp(told.outer) >= 2.0 * np.pi
    speed = np.abs(np.diff(told.outer)) / np.maximum(np.diff(told.time), 1e-9)
    assert np.rad2deg(speed.max()) <= QUICK["rate_dps"] * (1.0 + 1e-6)
    assert told.violations == ()
    assert told.limits["accel_bias_x"] == PRODUCT["limits"]["accel_bias"]["sigma_below"]


def test_a_departure_changes_time_and_sigma(site_folder: SiteFolder) -> None:
    short, long = (
        foretold(site_folder, "six_position"),
        foretold(site_folder, "six_position", six_position={"dwell_s": 20.0}),
    )
    assert long.duration == pytest.approx(short.duration + 6 * 17.0)
    i = INDEX["accel_scale_x"]
    assert short.stages[0].sigma is not None
    assert long.stages[0].sigma is not None
    assert long.stages[0].sigma[i] < short.stages[0].sigma[i]


def test_every_broken_limit_is_named_with_its_step(site_folder: SiteFolder) -> None:
    told = foretold(site_folder, "rate", "six_position", six_position={"rate_dps": 150.0})
    (violation,) = told.violations
    assert (violation.stage, violation.step, violation.label) == ("six_position", 1, ("face_up", "+z"))
    assert (violation.kind, violation.joint, violation.more) == ("rate", "", 5)
    assert np.rad2deg([violation.value, violation.high]) == pytest.approx([150.0, 120.0])
    assert "rate of 150 °/s is outside the table's 0 to 120 °/s" in sentence(violation.text)
    assert all(stage.sigma is None for stage in told.stages)
    assert told.duration > 0.0


def test_a_plan_that_finds_no_room_says_so(site_folder: SiteFolder) -> None:
    (violation,) = foretold(site_folder, "rate", rate={"turns": 50}).violations
    assert (violation.stage, violation.kind) == ("rate", "plan")
    assert violation.text.code == "plan.turns_exceed_travel"


def test_targets_end_a_repeated_stage_as_they_would_in_the_run(site_folder: SiteFolder) -> None:
    easy = foretold(site_folder, "azimuth_flip", azimuth_flip={"rounds": None, "targets": {"gyro_bias_x": 1e-6}})
    assert (easy.stages[0].reason, easy.stages[0].rounds) == ("targets", 1)
    assert easy.targets == {"gyro_bias_x": 1e-6}
    hopeless = {"rounds": None, "targets": {"accel_quadratic": 1e-12}, "dwell_s": 2.0}
    never = foretold(site_folder, "azimuth_flip", azimuth_flip=hopeless).stages[0]
    assert (never.reason, never.rounds) == ("", MOST_ROUNDS)


def test_no_unit_needs_to_be_named_and_progress_is_told(site_folder: SiteFolder) -> None:
    told = Told()
    compute_preview(told, site_folder.request("rate", serial="not yet"))
    assert told.fractions == sorted(told.fractions)
    assert 0.0 < told.fractions[-1] < 1.0
    assert set(told.notes) == {"rate"}


def test_a_wrong_schedule_names_its_field(site_folder: SiteFolder) -> None:
    with pytest.raises(ConfigurationError, match=r"schedule\.rate: dwell_s: 1.*at least 2"):
        foretold(site_folder, "rate", rate={"dwell_s": 1.0})


@pytest.mark.parametrize(("distance", "seconds"), [(2.0, 3.0), (0.25, 1.0), (0.0, 0.0), (-2.0, 3.0)])
def test_a_move_is_a_trapezoid_or_a_triangle(distance: float, seconds: float) -> None:
    t = np.linspace(0.0, 4.0, 401)
    angle = profile(t, 1.0, 1.0 + distance, 1.0, 1.0)
    assert angle[t >= seconds] == pytest.approx(1.0 + distance)
    if distance:
        assert abs(angle[t < seconds - 0.02][-1] - 1.0 - distance) > 1e-6
        assert np.abs(np.diff(angle)).max() <= 0.01 * (1.0 + 1e-9)


def test_a_stage_that_finds_its_rests_by_itself_can_be_foretold(site_folder: SiteFolder) -> None:
    told = foretold(site_folder, "multi_position", multi_position={"step_deg": 90.0, "rest_s": 3.0})
    stage = told.stages[0]
    assert stage.error is None
    assert stage.sigma is not None
    for name in stage.estimated:
        assert stage.sigma[INDEX[name]] < 0.2 * told.before[INDEX[name]], name
