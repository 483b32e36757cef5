"""Acceptance checks of a product in a run and in its re-solved log, on a manual rig and on the table."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from calstation.bench.truth import GRADES, ManualRig, around, draw_imu, record
from calstation.config import library
from calstation.estimation.common import SampleBlock
from calstation.judgement import judge
from calstation.physics import PARAMETERS
from calstation.records import LogMeta, RawLogWriter, context_from_meta, open_log
from calstation.results import resolve, solve
from calstation.results.plots.compensation import apply_to_recording, before_and_after
from calstation.results.plots.method_solution import PositionPlotData, solve_method
from tests.helpers import ignore_progress, sampled
from tests.site_folder import SiteFolder

CHECKS: dict[str, Any] = {
    "gravity_at_rest": {"within": 0.01},
    "improvement_at_rest": {"below": 0.5, "or_within": 2e-3},
    "level": {"horizontal_within": 0.5, "vertical_within": 0.02},
    "motion_angle": {"within": 2e-3, "below": 0.5, "or_within": 1e-3},
    "excitation": {"sigma_ratio_below": 0.5},
    "offline_online": {"within_sigmas": 0.0},
}
HELD = {"level_horizontal", "level_vertical", "motion_angle", "motion_improvement", "excitation"}


def hand_log(folder: Path, checks: dict[str, Any]) -> Path:
    """Write a raw log of a MEMS unit on a manual rig whose product has these checks and no limits."""
    rig = ManualRig(initial_rest=10.0, rest=3.0)
    imu = draw_imu("mems", np.random.default_rng(3), sample_rate=100.0)
    samples, _ = record(imu, rig, around(np.deg2rad(60.0)), 3)
    sigma = {p.name: {"sigma": 2.0 * GRADES["mems"].sigma[p.group]} for p in PARAMETERS}
    meta = LogMeta.model_validate(
        {
            "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400},
            "imu": {
                "serial": "H-1",
                "sample_rate_hz": 100.0,
                "output": imu.output,
                "gyro_lsb": imu.gyro_lsb,
                "accel_lsb": imu.accel_lsb,
                "gyro_arw": float(imu.gyro_arw),
                "accel_vrw": float(imu.accel_vrw),
                "gyro_bias_instability": float(imu.gyro_bias_instability),
                "accel_bias_instability": float(imu.accel_bias_instability),
            },
            "prior": sigma,
            "product": {"name": "by hand", "checks": checks},
        }
    )
    path = folder / "hand.h5"
    writer = RawLogWriter(path, meta)
    valid, unknown = np.ones(len(samples.seq), np.bool_), samples.temperature
    writer.append(
        SampleBlock(
            "multi_position",
            samples.seq,
            samples.time,
            samples.counts,
            samples.angles,
            samples.step,
            valid,
            unknown,
        )
    )
    writer.close("imported")
    return path


def named(result: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {check["name"]: check for check in result["checks"]}


def test_manual_rig_recording_is_judged_by_the_product_checks(tmp_path: Path) -> None:
    result = resolve(hand_log(tmp_path, CHECKS)).result.to_json()
    checks = named(result)
    assert {"gravity_at_rest", "improvement_at_rest", *HELD} <= set(checks)
    assert result["passed"] is True
    for check in checks.values():
        assert check["passed"]
        assert isinstance(check["margin"], float)
        assert check["near_miss"] in (True, False)
    assert checks["gravity_at_rest"]["where"].startswith("multi_position rest")
    assert 1e-5 < checks["motion_angle"]["value"] < 2e-3
    assert checks["motion_improvement"]["value"] < checks["motion_improvement"]["limit"] == 0.5
    assert checks["improvement_at_rest"]["limit"] == 0.5
    assert checks["improvement_at_rest_floor"]["limit"] == 2e-3


def test_failed_check_fails_the_unit_and_reports_its_position(tmp_path: Path) -> None:
    strict = {"improvement_at_rest": {"below": 1e-6}, "near_miss_beyond": 0.5}
    result = resolve(hand_log(tmp_path, strict)).result.to_json()
    assert result["passed"] is False
    assert not named(result)["improvement_at_rest"]["passed"]


def test_the_force_at_rest_is_the_same_on_both_pages_of_a_recording(tmp_path: Path) -> None:
    """The table may move at the ends of a rest, which a plain mean shows and the mean of the solution hardly does."""
    path = hand_log(tmp_path, CHECKS)
    answer = solve_method(ignore_progress, path, "multi_position")
    assert isinstance(answer.plot_data, PositionPlotData)
    vectors = before_and_after({name: value for name, (value, _) in answer.before.items()}, answer.parameters)
    applied = apply_to_recording(ignore_progress, path, {}, *vectors)
    expected = np.column_stack([answer.plot_data.force_before, answer.plot_data.force_after])
    np.testing.assert_allclose(applied.rest_length, expected, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(applied.length_rms, np.sqrt(np.mean(expected**2, axis=0)), rtol=1e-9)


@pytest.fixture
def judged(site_folder: SiteFolder) -> SiteFolder:
    site_folder.write({"checks": {**CHECKS, "previous": {"change_within": {"accel_scale": 1e-5}}}})
    return site_folder


@pytest.mark.long
def test_run_and_its_log_are_judged_alike_and_against_the_previous_run(judged: SiteFolder) -> None:
    first = judged.run("six_position")
    checks = named(first.result)
    assert {"gravity_at_rest", "improvement_at_rest", "level_vertical", "motion_angle"} <= set(checks)
    assert not any(name.startswith("previous") for name in checks)
    again = resolve(Path(first.log)).result.to_json()
    assert again["checks"][: len(first.result["checks"])] == first.result["checks"]
    assert named(again)["offline_online"]["value"] == 0.0
    second = judged.run("six_position")
    previous = named(second.result)["previous accel_scale"]
    assert previous["passed"]
    assert 0.0 <= previous["value"] < 1e-5


def test_product_file_with_a_misspelled_check_is_refused(site_folder: SiteFolder) -> None:
    site_folder.product.write_text(
        site_folder.product.read_text() + tomli_w.dumps({"checks": {"gravity": {"within": 1.0}}})
    )
    with pytest.raises(Exception, match="Did you mean 'gravity_at_rest'"):
        site_folder.run("six_position")


GRADE = {"nav_a": "nav", "tactical_b": "tactical", "mems_c": "mems"}
FOUR_STAGES = {"gravity_at_rest", "level_horizontal", "level_vertical", "motion_angle"}


@pytest.mark.long
@pytest.mark.parametrize("product", sampled(3, ["mems_c", "nav_a", "tactical_b"]))
def test_checks_of_a_shipped_product_pass_a_good_unit_and_detect_changes(product: str, site_folder: SiteFolder) -> None:
    site_folder.write({"bench_grade": GRADE[product]})
    site_folder.product = library.find("products", product)
    ended = site_folder.run()
    checks = named(ended.result)
    assert ended.verdict.passed
    assert set(checks) >= FOUR_STAGES
    assert {"improvement_at_rest", "improvement_at_rest_floor"} & set(checks)
    assert {"motion_improvement", "motion_improvement_floor"} & set(checks)
    improved = {name: c for name, c in checks.items() if name in FOUR_STAGES or "improvement" in name}
    assert max(c["value"] / c["limit"] for c in improved.values()) < 0.8

    log = open_log(Path(ended.log))
    size = context_from_meta(log.meta).imu.count_size
    rules = log.meta.product.checks

    def failed(change: Callable[[SampleBlock], np.ndarray]) -> set[str]:
        """Return the checks that fail if the output of the unit is multiplied by this factor."""
        chain = solve(lambda: (replace(b, counts=change(b)) for b in log.blocks()), log.meta)
        return {c.name for c in judge(log.meta, chain.prior, tuple(chain.solutions)).checks if not c.passed}

    def knocked(block: SampleBlock) -> np.ndarray:
        jump = 3.0 * rules.gravity_at_rest.within / size[5]
        return block.counts + np.eye(6)[5] * (jump if block.stage in ("excitation", "azimuth_flip") else 0.0)

    excitation = [b.seq for b in log.blocks() if b.stage == "excitation"]
    middle = (excitation[0][0] + excitation[-1][-1]) // 2

    def slower(block: SampleBlock) -> np.ndarray:
        return block.counts * (1.0 + np.outer(block.seq > middle, np.eye(6)[0] * 2.0 * rules.motion_angle.within))

    assert "gravity_at_rest" in failed(knocked)
    assert "motion_angle" in failed(slower)
