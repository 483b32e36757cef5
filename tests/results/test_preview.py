"""A preview gives the sigmas and duration of the run, and all table limits that a plan violates."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calstation.config import RunRequest, library, load_configuration
from calstation.designer.design import stages_duration
from calstation.errors import ConfigurationError
from calstation.estimation.common import profile
from calstation.messages import sentence
from calstation.physics import INDEX
from calstation.results import Preview, compute_preview
from calstation.results.preview import MAX_ROUNDS
from calstation.runs import run_summary
from calstation.sequencer import StageStarted
from tests.helpers import Progress
from tests.site_folder import PRODUCT, QUICK, SiteFolder


def preview_of(site_folder: SiteFolder, *stages: str, **schedule: dict[str, object]) -> Preview:
    """Return the preview of stages with changes to the schedule of the product."""
    return compute_preview(Progress(), replace(site_folder.request(*stages), schedule=schedule))


@pytest.mark.long
def test_previewed_sigmas_equal_the_sigmas_of_the_run(site_folder: SiteFolder) -> None:
    preview = compute_preview(Progress(), site_folder.request())
    result = site_folder.run().result
    assert [s.stage for s in preview.stages] == result["stages"]
    assert len(result["parameters"]) == 30
    final = preview.stages[-1].sigma
    assert final is not None
    for name, parameter in result["parameters"].items():
        assert final[INDEX[name]] == pytest.approx(parameter["sigma"], rel=0.15), name
    for stage, started in zip(preview.stages, site_folder.events_of(StageStarted), strict=True):
        assert stage.end - stage.begin == pytest.approx(started.duration, abs=5.0)


@pytest.mark.long
def test_preview_of_a_single_stage_excludes_information_of_other_stages(site_folder: SiteFolder) -> None:
    alone, after = preview_of(site_folder, "azimuth_flip"), preview_of(site_folder, "excitation", "azimuth_flip")
    i = INDEX["gyro_bias_x"]
    assert alone.stages[0].sigma is not None
    assert after.stages[1].sigma is not None
    assert after.stages[1].sigma[i] < alone.stages[0].sigma[i] < alone.before[i]
    scale = INDEX["gyro_scale_x"]
    assert alone.stages[0].sigma[scale] == alone.before[scale]
    assert after.stages[0].observability["states"]["gyro_scale_x"]["step"] is not None
    flips = [segment["step"] for segment in after.stages[1].observability["segments"]]
    assert [after.step_labels[step][0] for step in flips] == ["start", *["flip"] * (len(flips) - 1)]


def test_preview_designer_and_operator_page_state_the_same_durations(site_folder: SiteFolder) -> None:
    request = site_folder.request()
    preview = compute_preview(Progress(), request)
    listed = run_summary(request).stages
    assert [(s.stage, s.end - s.begin) for s in preview.stages] == [
        (stage.name, pytest.approx(stage.duration)) for stage in listed
    ]
    assert stages_duration(load_configuration(request)) == pytest.approx(preview.duration)


def test_previewed_trajectory_follows_the_plan(site_folder: SiteFolder) -> None:
    preview = preview_of(site_folder, "rate", "six_position")
    rate, six = preview.stages
    assert (rate.begin, six.begin, six.end) == (0.0, rate.end, preview.duration)
    assert rate.moves == 9
    assert six.moves == 11
    assert np.all(np.diff(preview.time) >= -1e-9)
    assert preview.time[-1] == pytest.approx(preview.duration)
    assert np.ptp(preview.outer) >= 2.0 * np.pi
    speed = np.abs(np.diff(preview.outer)) / np.maximum(np.diff(preview.time), 1e-9)
    assert np.rad2deg(speed.max()) <= QUICK["rate_dps"] * (1.0 + 1e-6)
    assert preview.violations == ()
    assert preview.limits["accel_bias_x"] == PRODUCT["limits"]["accel_bias"]["sigma_below"]


def test_a_changed_schedule_changes_duration_and_sigma(site_folder: SiteFolder) -> None:
    short, long = (
        preview_of(site_folder, "six_position"),
        preview_of(site_folder, "six_position", six_position={"dwell_s": 20.0}),
    )
    assert long.duration == pytest.approx(short.duration + 6 * 17.0)
    i = INDEX["accel_scale_x"]
    assert short.stages[0].sigma is not None
    assert long.stages[0].sigma is not None
    assert long.stages[0].sigma[i] < short.stages[0].sigma[i]


@pytest.mark.long
def test_preview_names_the_parameters_whose_check_the_run_would_fail(site_folder: SiteFolder) -> None:
    preview = preview_of(site_folder, "azimuth_flip")
    result = site_folder.run("azimuth_flip").result
    assert list(preview.undetermined) == result["unobservable"] == ["gyro_bias_z"]
    assert preview.not_improved == ()


def test_every_violated_limit_is_reported_with_its_step(site_folder: SiteFolder) -> None:
    preview = preview_of(site_folder, "rate", "six_position", six_position={"rate_dps": 150.0})
    (violation,) = preview.violations
    assert (violation.stage, violation.step, violation.label) == ("six_position", 1, ("face_up", "+z"))
    assert (violation.kind, violation.joint, violation.more) == ("rate", "", 10)
    assert np.rad2deg([violation.value, violation.high]) == pytest.approx([150.0, 120.0])
    assert "rate of 150 °/s is outside the table's 0 to 120 °/s" in sentence(violation.text)
    assert all(stage.sigma is None for stage in preview.stages)
    assert preview.duration > 0.0


def test_plan_beyond_the_travel_is_a_violation(site_folder: SiteFolder) -> None:
    (violation,) = preview_of(site_folder, "rate", rate={"turns": 50}).violations
    assert (violation.stage, violation.kind) == ("rate", "plan")
    assert violation.text.code == "plan.turns_exceed_travel"


@pytest.mark.long
def test_targets_end_a_repeated_stage_as_in_the_run(site_folder: SiteFolder) -> None:
    easy = preview_of(site_folder, "azimuth_flip", azimuth_flip={"rounds": None, "targets": {"gyro_bias_x": 1e-6}})
    assert (easy.stages[0].reason, easy.stages[0].rounds) == ("targets", 1)
    assert easy.targets == {"gyro_bias_x": 1e-6}
    hopeless = {"rounds": None, "targets": {"accel_quadratic": 1e-12}, "dwell_s": 2.0}
    never = preview_of(site_folder, "azimuth_flip", azimuth_flip=hopeless).stages[0]
    assert (never.reason, never.rounds) == ("", MAX_ROUNDS)


def test_preview_needs_no_serial_number_and_reports_progress(site_folder: SiteFolder) -> None:
    preview = Progress()
    compute_preview(preview, site_folder.request("rate", serial="not yet"))
    assert preview.fractions == sorted(preview.fractions)
    assert 0.0 < preview.fractions[-1] < 1.0
    assert set(preview.notes) == {"rate"}


def test_invalid_schedule_is_reported_with_its_field(site_folder: SiteFolder) -> None:
    with pytest.raises(ConfigurationError, match=r"schedule\.rate: dwell_s: 1.*at least 2"):
        preview_of(site_folder, "rate", rate={"dwell_s": 1.0})


@pytest.mark.parametrize(("distance", "seconds"), [(2.0, 3.0), (0.25, 1.0), (0.0, 0.0), (-2.0, 3.0)])
def test_move_profile_is_a_trapezoid_or_a_triangle(distance: float, seconds: float) -> None:
    t = np.linspace(0.0, 4.0, 401)
    angle = profile(t, 1.0, 1.0 + distance, 1.0, 1.0)
    assert angle[t >= seconds] == pytest.approx(1.0 + distance)
    if distance:
        assert abs(angle[t < seconds - 0.02][-1] - 1.0 - distance) > 1e-6
        assert np.abs(np.diff(angle)).max() <= 0.01 * (1.0 + 1e-9)


def test_stage_with_detected_rests_is_previewed(site_folder: SiteFolder) -> None:
    preview = preview_of(site_folder, "multi_position", multi_position={"step_deg": 90.0, "rest_s": 3.0})
    stage = preview.stages[0]
    assert stage.error is None
    assert stage.sigma is not None
    for name in stage.estimated:
        assert stage.sigma[INDEX[name]] < 0.2 * preview.before[INDEX[name]], name


@pytest.mark.parametrize(
    ("station", "product", "reason"),
    [
        ("virtual_hand", "mems_hand", "preview.manual_motion"),
        ("virtual_gimbal", "mems_gimbal", "preview.gimbal_motion"),
        ("virtual_chamber", "mems_c_thermal", "preview.over_temperature"),
    ],
)
def test_stage_whose_sigmas_cannot_be_predicted_is_not_called_unsolvable(
    tmp_path: Path, station: str, product: str, reason: str
) -> None:
    files = library.find("stations", station), library.find("products", product)
    (stage,) = compute_preview(Progress(), RunRequest("SN-000001", *files, out=tmp_path)).stages
    assert stage.error is not None
    assert (stage.sigma, stage.predictable, stage.error.code) == (None, False, reason)
    assert stage.moves > 3
