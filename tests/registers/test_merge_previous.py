"""A part of the stages does not replace what an earlier calibration found far better."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from calstation.results.merge_previous import VerifiedRegister, better_previous_values, condition_on

from calstation.config.request import computer_user
from calstation.estimation.common.context import Belief
from calstation.gui.text.messages import event_sentence
from calstation.messages.progress import event_text
from calstation.messages.rendering import sentence
from calstation.physics.parameters import COUNT, INDEX
from calstation.results.history import History
from calstation.sequencer.events import Message
from tests.results.test_history import refreshed, write
from tests.site_folder import SiteFolder

SCALE, BIAS = INDEX["accel_scale_x"], INDEX["accel_bias_x"]
BEFORE = {"accel_scale_x": VerifiedRegister(5e-4, 1e-7, "2026-11-21T08:00:00+00:00")}


def belief(scale: float = 3e-4, sigma: float = 85e-6) -> Belief:
    """Scale and bias known together to 1e-6 of gravity, each alone to `sigma`."""
    mean, covariance = np.zeros(COUNT), np.eye(COUNT)
    mean[SCALE], mean[BIAS] = scale, 0.0
    covariance[SCALE, SCALE], covariance[BIAS, BIAS] = sigma**2, (10 * sigma) ** 2 + 1e-10
    covariance[SCALE, BIAS] = covariance[BIAS, SCALE] = -10 * sigma**2
    return Belief(mean, covariance)


def better(held: float, found: Belief, *, after_registers: bool = False) -> list[tuple[str, bool]]:
    earlier = better_previous_values(
        {"accel_scale_x": held}, found, ("accel_scale_x",), BEFORE, after_registers=after_registers
    )
    return [(parameter.name, parameter.contradicted) for parameter in earlier]


def test_a_much_better_earlier_value_is_kept() -> None:
    assert better(5e-4, belief()) == [("accel_scale_x", False)]
    assert better(5e-4, belief(0.0), after_registers=True) == [("accel_scale_x", False)]


def test_equally_good_or_changed_registers_are_not_kept() -> None:
    assert better(5e-4, belief(sigma=1.9e-7)) == []
    assert better(0.0, belief()) == []
    assert better(float("nan"), belief()) == []


def test_a_unit_that_has_changed_is_not_kept() -> None:
    assert better(5e-4, belief(3e-3)) == [("accel_scale_x", True)]
    assert better(5e-4, belief(3e-3), after_registers=True) == [("accel_scale_x", True)]


@pytest.mark.parametrize("behind", [False, True])
def test_the_other_registers_fit_the_kept_ones(behind: bool) -> None:
    found, held = belief(3e-4 - 5e-4 * behind), {"accel_scale_x": 5e-4}
    kept = better_previous_values(held, found, held, BEFORE, after_registers=behind)
    after = condition_on(found, kept, held, after_registers=behind)
    assert after.mean[SCALE] == pytest.approx(5e-4 * (not behind), abs=1e-8)
    assert after.mean[BIAS] == pytest.approx(-2e-3, rel=1e-4)
    assert after.sigma[BIAS] == pytest.approx(1e-5, rel=0.01)
    assert condition_on(found, (), held, after_registers=behind) is found


def test_current_registers_are_the_last_verified_ones(tmp_path: Path) -> None:
    def run(name: str, day: int, outcome: str = "passed", verified: bool = True, **more: object) -> None:
        registers = {"old": {}, "new": {"gyro_scale_x": 1e-4 * day}, "verified": verified, **more}
        write(tmp_path, name, "SN-1", outcome, day, values={"gyro_scale_x": 1.0}, registers=registers)

    run("a", 1)
    run("b", 2, kept={"gyro_scale_x": {}})
    run("c", 3, outcome="failed")
    run("d", 4, verified=False)
    for history in (refreshed(tmp_path), History(tmp_path)):
        found = history.verified_registers("SN-1")["gyro_scale_x"]
        assert found == VerifiedRegister(1e-4, 1.0, "2026-11-01T08:00:00+00:00")


@pytest.mark.long
def test_a_partial_run_keeps_registers_and_reports_it(site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = {"stages": ["six_position"]}
    site_folder.write(whole, flash_file=str(site_folder.folder / "flash.bin"))
    first = site_folder.run()
    assert (first.outcome, first.result["partial"]) == ("passed", False)
    path = Path(first.result_file)
    result = json.loads(path.read_text(encoding="utf-8"))
    result["parameters"]["accel_scale_x"]["sigma"] /= 3.0  # as a longer run would have found it
    path.write_text(json.dumps(result), encoding="utf-8")
    site_folder.write({"stages": ["rate", "six_position"]}, flash_file=str(site_folder.folder / "flash.bin"))
    site_folder.events.clear()
    asked = replace(site_folder.request("six_position"), operator=None)
    monkeypatch.setattr(site_folder, "request", lambda *_: asked)
    second = site_folder.run("six_position")
    assert second.result["operator"] == computer_user()
    assert (second.outcome, second.result["partial"]) == ("passed", True)
    registers = second.result["registers"]
    assert set(registers["kept"]) == {"accel_scale_x"}
    assert registers["new"]["accel_scale_x"] == registers["old"]["accel_scale_x"]
    assert registers["new"]["accel_scale_y"] != registers["old"]["accel_scale_y"]
    assert registers["verified"]
    (told,) = (message for message in site_folder.events_of(Message) if message.id == "better_kept")
    for said in (event_sentence(told.id, told.values), sentence(event_text(told.id, told.values))):
        assert said.startswith("accel_scale_x kept: ")
        assert said.endswith(" ppm now.")
