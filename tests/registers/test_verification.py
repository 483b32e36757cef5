"""Verification of a transfer: correct registers pass on every unit, wrong profile conventions fail."""

from typing import Any

import numpy as np
import pytest

from calstation.bench.imu import UNITS
from calstation.physics import NAMES
from calstation.registers import AppliedRegisters
from calstation.registers.verification import compare
from tests.helpers import sampled
from tests.registers.verification_scene import GRADES, Captures, profile, profile_data, recording


def failed_comparisons(protocol: str, grade: str, seed: int, changed: Any = None, larger: float = 1.0) -> list[str]:
    """Return the failed comparisons after the true parameters were written with a (changed) profile."""
    data = profile_data(protocol)
    if changed is not None:
        changed(data)
    captures = Captures(protocol, recording(grade, seed, data["stream"]["output"], larger))
    values = dict(zip(NAMES, captures.bench.parameters.tolist(), strict=True))
    return [check.name for check in captures.verified(profile(data), values) if not check.passed]


@pytest.mark.parametrize(("protocol", "grade"), sampled(4, UNITS, GRADES))
def test_correct_registers_pass_verification(protocol: str, grade: str) -> None:
    for seed in range(10):
        assert failed_comparisons(protocol, grade, seed) == [], seed


def swap(names: list[str], first: str, second: str) -> list[str]:
    """Return the names with two of them swapped."""
    return [second if n == first else first if n == second else n for n in names]


def entry(data: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the register entry that contains a name."""
    found: dict[str, Any] = next(e for e in data["registers"] if any(name in n for n in e["parameters"]))
    return found


def convention(name: str, **changes: Any) -> Any:
    """Change a convention of all registers of a sensor."""

    def change(data: dict[str, Any]) -> None:
        sensor = name.split("_")[0]
        for e in data["registers"]:
            if any(n.startswith((f"{sensor}_matrix", f"{sensor}_offset")) for n in e["parameters"]):
                e["convention"] = {**e.get("convention", {}), **changes}

    return change


def reorder(name: str, first: str, second: str) -> Any:
    """Swap two numbers of an entry."""

    def change(data: dict[str, Any]) -> None:
        e = entry(data, name)
        e["parameters"] = swap(e["parameters"], first, second)

    return change


def negate(name: str) -> Any:
    """Invert the sign of the scale."""

    def change(data: dict[str, Any]) -> None:
        e = entry(data, name)
        e["scale"] = -e.get("scale", 1.0)

    return change


def transpose(name: str, sensor: str) -> Any:
    """Swap rows and columns."""

    def change(data: dict[str, Any]) -> None:
        e = entry(data, name)
        if f"{sensor}_matrix" in e["parameters"]:
            e["major"] = "row" if e.get("major", "row") == "column" else "column"
            return
        names = e["parameters"]
        for a, b in (("xy", "yx"), ("xz", "zx"), ("yz", "zy")):
            names = swap(names, f"{sensor}_misalign_{a}", f"{sensor}_misalign_{b}")
        e["parameters"] = names

    return change


def as_correction(data: dict[str, Any]) -> None:
    """Interpret the error matrix of the framed unit as a correction without the identity."""
    matrix = entry(data, "gyro_scale")
    matrix |= {"parameters": ["gyro_matrix"], "convention": {"matrix": "correction", "identity": False}}
    bias = entry(data, "gyro_bias")
    bias |= {"parameters": ["gyro_offset"], "convention": {"matrix": "correction", "identity": False}}


def axes_of_offset(data: dict[str, Any]) -> None:
    """Put the z axis first."""
    entry(data, "gyro_offset")["parameters"] = ["gyro_offset_z", "gyro_offset_y", "gyro_offset_x"]


WRONG = {
    ("framed", "gyro bias negated"): negate("gyro_bias"),
    ("framed", "gyro matrix negated"): negate("gyro_scale"),
    ("framed", "accelerometer matrix negated"): negate("accel_scale"),
    ("framed", "accelerometer bias negated"): negate("accel_bias"),
    ("framed", "gyro matrix transposed"): transpose("gyro_scale", "gyro"),
    ("framed", "correction for error"): as_correction,
    ("framed", "axes of the gyro's scale"): reorder("gyro_scale", "gyro_scale_x", "gyro_scale_y"),
    ("framed", "axes of the accelerometer's bias"): reorder("accel_bias", "accel_bias_x", "accel_bias_z"),
    ("modbus", "accelerometer matrix negated"): convention("accel_matrix", negated=False),
    ("modbus", "gyro offset negated"): convention("gyro_offset", added=False),
    ("modbus", "gyro matrix transposed"): transpose("gyro_matrix", "gyro"),
    ("modbus", "correction for error"): convention("gyro_matrix", matrix="correction"),
    ("modbus", "axes of the gyro's offset"): axes_of_offset,
    ("vectornav", "gyro offset negated"): convention("gyro_offset", added=True),
    ("vectornav", "error for correction"): convention("accel_matrix", matrix="error"),
    ("vectornav", "error for correction of the gyro"): convention("gyro_matrix", matrix="error"),
    ("vectornav", "gyro matrix transposed"): transpose("gyro_matrix", "gyro"),
    ("vectornav", "accelerometer matrix transposed"): transpose("accel_matrix", "accel"),
}


@pytest.mark.parametrize(("protocol", "what"), WRONG)
def test_a_wrong_convention_fails_verification(protocol: str, what: str) -> None:
    grade = "nav" if protocol == "framed" else "mems"
    for seed in range(3):
        failed = failed_comparisons(protocol, grade, seed, WRONG[protocol, what])
        assert any("difference" in name for name in failed), (seed, failed)


@pytest.mark.parametrize("protocol", ["modbus", "vectornav"])
def test_wrong_order_of_bias_and_matrix_fails_verification(protocol: str) -> None:
    """The orders differ by the product of bias and matrix, which is visible only for large errors."""
    other = "before" if protocol == "modbus" else "after"
    change = convention("gyro_offset", offset=other)
    failed = failed_comparisons(protocol, "mems", 3, change, larger=12.0)
    assert "rate_difference" in failed
    assert failed_comparisons(protocol, "mems", 3, larger=12.0) == []


def test_verification_detects_errors_of_the_stated_size() -> None:
    """For a navigation-grade unit, an error of the stated size in any single register is detected."""
    resolved = {
        "gyro_bias": 1.6e-6,
        "gyro_scale": 3.7e-5,
        "gyro_misalign": 9e-5,
        "accel_bias": 3.6e-3,
        "accel_scale": 5.0e-4,
        "accel_misalign": 6.0e-4,
        "accel_quadratic": 5.0e-5,
    }
    captures = Captures("framed", recording("nav", 1, "increment"))
    values = dict(zip(NAMES, captures.bench.parameters.tolist(), strict=True))
    right = profile(profile_data("framed"))
    assert all(check.passed for check in captures.verified(right, values))
    reference, own = captures.capture(corrected=False), captures.capture(corrected=True)
    for name in NAMES:
        group = name.rsplit("_", 1)[0]
        if group not in resolved:
            continue
        for sign in (1.0, -1.0):
            meant = {**values, name: values[name] + sign * resolved[group]}
            checks = compare(own, reference, AppliedRegisters(meant), captures.context, np.deg2rad(0.0005))
            assert not all(check.passed for check in checks), name
