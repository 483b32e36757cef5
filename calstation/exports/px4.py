"""Parameters of PX4 as QGroundControl loads them: vehicle, component, name, value and MAVLink type per line."""

from collections.abc import Mapping

from calstation.exports.autopilot import autopilot_format

#: MAV_PARAM_TYPE_REAL32.
_REAL32 = 9
_NAMES = {
    "accel_offset": "CAL_ACC0_{axis}OFF",
    "accel_factor": "CAL_ACC0_{axis}SCALE",
    "gyro_offset": "CAL_GYRO0_{axis}OFF",
}


def _dump(parameters: Mapping[str, float], serial: str) -> str:
    head = (
        f"# Onboard parameters of the IMU {serial}, from calstation",
        "#",
        "# Vehicle-Id Component-Id Name Value Type",
    )
    rows = (f"1\t1\t{name}\t{value!r}\t{_REAL32}" for name, value in parameters.items())
    return "\n".join((*head, *rows, ""))


def _load(text: str) -> dict[str, float]:
    rows = (line.split("\t") for line in text.splitlines() if not line.startswith("#"))
    return {name: float(value) for _, _, name, value, _ in rows}


FORMAT = autopilot_format(_NAMES, _dump, _load)
