"""Parameters of ArduPilot as Mission Planner and MAVProxy load them: name and value per line."""

from collections.abc import Mapping

from calstation.exports.autopilot import autopilot_format

_NAMES = {
    "accel_offset": "INS_ACCOFFS_{axis}",
    "accel_factor": "INS_ACCSCAL_{axis}",
    "gyro_offset": "INS_GYROFFS_{axis}",
}


def _dump(parameters: Mapping[str, float], serial: str) -> str:
    return "\n".join(
        (f"# IMU {serial}, from calstation", *(f"{name},{value!r}" for name, value in parameters.items()), "")
    )


def _load(text: str) -> dict[str, float]:
    rows = (line.split(",") for line in text.splitlines() if not line.startswith("#"))
    return {name: float(value) for name, value in rows}


FORMAT = autopilot_format(_NAMES, _dump, _load)
