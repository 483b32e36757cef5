"""Runs at a manual rig station: guidance, solution, verdict, register write, re-solving."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from calstation.config import (
    RunRequest,
    is_manual_table,
    library,
    load_station,
    schedule_options,
)
from calstation.connection import LinkTestRequest, check_table_link
from calstation.errors import ConfigurationError
from calstation.estimation.common import ImuModel, Site, SolveContext, TableModel
from calstation.messages import Text
from calstation.physics import PARAMETERS, rotation_matrix
from calstation.records import open_log
from calstation.registers import AppliedRegisters, verify_output
from calstation.results import compute_preview, resolve
from calstation.runs import run_summary
from calstation.sequencer import Message, PositionGuided, VerificationData
from tests.prepared import prepare_run
from tests.site_folder import STATION, SiteFolder

SHORT = {"manual": True, "initial_rest_s": 5.0, "rest_s": 2.0, "step_deg": 120.0, "rate_dps": 90.0}
PRODUCT = {
    "name": "by hand",
    "imu": "bench_mems",
    "bench_grade": "mems",
    "stages": ["multi_position"],
    "schedule": {"multi_position": SHORT},
    "limits": {
        "gyro_bias": {"within": 0.0052, "sigma_below": 1e-4},
        "gyro_scale": {"within": 0.0036, "sigma_below": 1e-3},
        "accel_bias": {"within": 0.024, "sigma_below": 5e-3},
        "accel_scale": {"within": 0.003, "sigma_below": 5e-4},
    },
}


class Rig(SiteFolder):
    """A site folder with a manual rig."""

    def write(self, product: dict[str, Any] | None = None, station: dict[str, Any] | None = None, **more: Any) -> None:
        site = {key: value for key, value in STATION["site"].items() if key != "azimuth_deg"}
        site["gravity_mps2"] = 9.79547
        settings = {"table": {"profile": "hand_rails"}, "site": site, "bench": {"seed": 5, **more}, **(station or {})}
        super().write({**PRODUCT, **(product or {})}, settings)


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def no_progress(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """Ignore progress reports."""


@pytest.mark.long
def test_guided_run_passes_writes_registers_and_re_solves_bit_identically(rig: Rig) -> None:
    ended = rig.run()
    result = ended.result
    assert ended.verdict.passed, [c for c in result["checks"] if not c["passed"]]
    assert result["registers"]["verified"]
    proof = {check["name"]: check for check in result["registers"]["proof"]}
    assert proof["carried_turn"]["passed"]
    assert not {"outer_turn", "inner_turn"} & set(proof)
    guided = [event for event in rig.events_of(PositionGuided) if event.stage]
    planned = run_summary(rig.request())
    assert {event.state for event in guided} >= {"waiting", "still", "moving", "enough"}
    assert guided[-1].index == guided[-1].count == len(planned.positions)
    done = np.reshape(guided[-1].done, (-1, 3))
    away = np.arccos(np.clip((done * planned.positions).sum(axis=1), -1.0, 1.0))
    assert np.rad2deg(away).max() < 25.0  # an operator stops near the position
    assert {m.id for m in rig.events_of(Message)}.isdisjoint({"homing", "checking_mounting", "finishing"})
    log = open_log(Path(ended.log))
    blocks = [block for block in log.blocks() if block.stage == "multi_position"]
    assert np.isnan(np.concatenate([block.angles for block in blocks])).all()
    assert np.concatenate([block.valid for block in blocks]).all()
    assert len(np.unique(np.concatenate([block.step for block in blocks]))) == len(planned.positions)
    again = resolve(Path(ended.log)).result.to_json()
    assert again["parameters"] == result["parameters"]


def test_stages_that_require_a_table_are_refused_before_opening_a_device(rig: Rig) -> None:
    with pytest.raises(ConfigurationError, match=r"Rate needs a driven table.*turned by hand"):
        prepare_run(rig.request("rate"))
    with pytest.raises(ConfigurationError, match="Six positions needs a driven table"):
        run_summary(rig.request("multi_position", "six_position"))
    rig.write({"schedule": {"multi_position": {**SHORT, "manual": False}}})
    with pytest.raises(ConfigurationError, match=r"schedule\.multi_position\.manual .* must be true"):
        compute_preview(no_progress, rig.request())


def test_manual_stages_require_a_manual_rig(rig: Rig) -> None:
    driven = tomli_w.dumps({**STATION, "bench": {"seed": 5}})
    rig.station.write_text(driven, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"schedule\.multi_position\.manual .* is true, but the table"):
        prepare_run(rig.request())


def test_preview_gives_time_and_positions_but_no_sigmas(rig: Rig) -> None:
    planned = run_summary(rig.request())
    assert planned.by_hand
    assert len(planned.positions) == 20
    assert np.allclose(np.linalg.norm(planned.positions, axis=1), 1.0)
    assert planned.positions[0] == (0.0, 0.0, 1.0)
    previewed = compute_preview(no_progress, rig.request())
    assert previewed.stages[0].end == pytest.approx(planned.stages[0].duration)
    assert previewed.stages[0].error == Text("preview.manual_motion")
    assert np.abs(previewed.inner).max() == pytest.approx(2.0 * np.pi)
    assert schedule_options(rig.station, rig.product).offered == ("multi_position",)


def test_manual_rig_needs_no_port_and_has_no_link_test(tmp_path: Path) -> None:
    path = tmp_path / "station.toml"
    file = {**STATION, "table": {"profile": "hand_rails"}, "imu": {"port": "/dev/ttyUSB7"}}
    path.write_text(tomli_w.dumps(file), encoding="utf-8")
    _, station = load_station(path)
    product = library.find("products", "mems_hand")
    report = check_table_link(no_progress, LinkTestRequest(station, product))
    assert [(f.id, f.state) for f in report.findings] == [("by_hand", "ok")]
    path.write_text(tomli_w.dumps({**file, "imu": {}}), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"imu\.port: The port is missing"):
        load_station(path)
    path.write_text(tomli_w.dumps({**file, "table": {"profile": "bench"}}), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"table\.port: The port is missing"):
        load_station(path)
    assert not is_manual_table("bench")


def test_shipped_station_and_product_are_compatible() -> None:
    request = RunRequest("SN-1", library.find("stations", "virtual_hand"), library.find("products", "mems_hand"))
    setup = prepare_run(request)
    assert setup.table.by_hand
    assert run_summary(request).stages[0].duration < 600.0


@pytest.mark.parametrize(
    ("wrong", "passed"),
    [
        (np.eye(3), True),
        (np.diag([1.0 + 1e-4, 1.0, 1.0]), True),
        (np.diag([1.01, 1.0, 1.0]), False),
        (np.diag([-1.0, 1.0, 1.0]), False),
        (np.eye(3)[[1, 0, 2]], False),
    ],
)
def test_manual_rotation_reveals_gyro_errors(wrong: np.ndarray, passed: bool) -> None:
    """The unit is rotated by half a turn about x and slightly about y; gravity gives the end position."""
    imu = ImuModel("S", 100.0, "rate", 1e-6, 1e-5, 4e-5, 6e-4)
    context = SolveContext(Site(0.6, 0.0, 0.0, None, 9.8), imu, TableModel())
    covariance = np.diag([1e-10 if p.group.startswith("gyro") else 1e-8 for p in PARAMETERS])
    share = np.linspace(0.0, np.pi, 300)
    omega = np.column_stack([np.full(300, np.pi / 3.0), 0.4 * np.sin(2.0 * share), np.zeros(300)])
    C = np.eye(3)
    for rate in omega:
        C = C @ rotation_matrix(0.01 * rate)
    first, second = np.r_[0.0, 0.0, 0.0, 0.0, 0.0, 9.8], np.r_[np.zeros(3), 9.8 * C[2]]
    seen = np.hstack([omega @ wrong.T, np.zeros((300, 3))])
    fresh = VerificationData((first, second), 10.0, carried=seen, period=0.01, corrected=True)
    checks = verify_output(fresh, AppliedRegisters({}), covariance, context, 1e-5)
    (turn,) = [check for check in checks if check.name == "carried_turn"]
    assert turn.passed is passed
    assert turn.expected == 0.0
