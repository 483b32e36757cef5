"""What happens to two IMUs that are watched, and the schedule by which they are, in the language in force."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QCoreApplication

from calstation.gui.logs.methods.figures import three_digits
from calstation.gui.text import show
from calstation.physics import DEGREE_PER_HOUR, MICRO_G
from calstation.results import PairProgress
from calstation.results.plots import PairEvent

SENSORS = ("gyro", "accel")
_UNITS = {"gyro": ("°/h", DEGREE_PER_HOUR), "accel": ("µg", MICRO_G)}


def word_sensor(sensor: str) -> str:
    """Gyro or accelerometer."""
    return (
        QCoreApplication.translate("pairs", "gyro")
        if sensor == "gyro"
        else QCoreApplication.translate("pairs", "accelerometer")
    )


def shown(sensor: str, value: float) -> str:
    """What a sensor shows at rest, in the unit people read."""
    unit, size = _UNITS[sensor]
    return f"{three_digits(value / size)} {unit}"


def word_state(followed: PairProgress) -> str:
    """What is waited for now."""
    if followed.state == "checking":
        return QCoreApplication.translate("pairs", "waiting for a rest to check at")
    if followed.state == "calibrating" and followed.motion >= 1.0:
        return QCoreApplication.translate("pairs", "waiting for motion about all axes")
    if followed.state == "calibrating":
        return QCoreApplication.translate("pairs", "waiting for motion: {0} % collected").format(
            f"{100.0 * followed.motion:.0f}"
        )
    return QCoreApplication.translate("pairs", "following the recording")


def short_happening(h: PairEvent) -> str:
    """What happened, in a few words."""
    name = QCoreApplication.translate("pairs", "IMU {0}").format(h.number)
    said = {
        "triggered": QCoreApplication.translate("pairs", "triggered"),
        "checked": QCoreApplication.translate("pairs", "{0} checked").format(name),
        "primary_off": QCoreApplication.translate("pairs", "primary off itself"),
        "calibrating": QCoreApplication.translate("pairs", "off: waiting for motion"),
        "calibrated": QCoreApplication.translate("pairs", "{0} calibrated").format(name),
        "given_up": QCoreApplication.translate("pairs", "given up"),
    }
    return said.get(h.kind, h.kind.replace("_", " "))


def why_given_up(followed: PairProgress) -> str:
    """Why the last calibration was given up, "" where none was."""
    reasons = [h.values["why"] for h in followed.happened if h.kind == "given_up"]
    return show(reasons[-1]) if reasons else ""


def word_schedule(schedule: Mapping[str, Any]) -> str:
    """The schedule in force as sentences."""
    when = {
        "command": QCoreApplication.translate("pairs", "Checked by command"),
        "start_up": QCoreApplication.translate("pairs", "Checked at start-up"),
        "period": QCoreApplication.translate("pairs", "Checked at start-up and every {0} s").format(
            f"{schedule['period_s']:g}"
        ),
    }[schedule["trigger"]]
    which = {
        "all": QCoreApplication.translate("pairs", "then all of a secondary that is off is calibrated"),
        "triggering": QCoreApplication.translate("pairs", "then only the sensor that is off is calibrated"),
    }[schedule["sensors"]]
    fitted = {
        "bias": QCoreApplication.translate("pairs", "bias"),
        "scale": QCoreApplication.translate("pairs", "bias and scale factors"),
        "full": QCoreApplication.translate("pairs", "bias and full matrix"),
    }[schedule["model"]]
    more = [fitted]
    if schedule["lever"] and schedule["model"] == "full":
        more.append(QCoreApplication.translate("pairs", "lever arm"))
    if schedule["clock_offset"]:
        more.append(QCoreApplication.translate("pairs", "clock offset"))
    motion = QCoreApplication.translate("pairs", "from {0} s of motion").format(f"{schedule['motion_s']:g}")
    first = QCoreApplication.translate("pairs", "{0} at a rest of {1} s; {2} ({3}), {4}.").format(
        when, f"{schedule['static_s']:g}", which, QCoreApplication.translate("pairs", ", ").join(more), motion
    )
    limits = QCoreApplication.translate("pairs", "; ").join(
        QCoreApplication.translate("pairs", "{0} {1} (primary {2})").format(
            word_sensor(s),
            _threshold(s, schedule[f"secondary_{s}"]),
            _threshold(s, schedule[f"primary_{s}"]),
        )
        for s in SENSORS
    )
    return QCoreApplication.translate("pairs", "{0} Off is beyond: {1}.").format(first, limits)


def _threshold(sensor: str, rule: Mapping[str, Any]) -> str:
    fixed = shown(sensor, rule["fixed"])
    if rule.get("offset") is not None:
        return QCoreApplication.translate(
            "pairs", "what it showed after the last calibration + {0}, at first {1}"
        ).format(shown(sensor, rule["offset"]), fixed)
    if rule.get("ratio") is not None:
        return QCoreApplication.translate(
            "pairs", "{0} times what it showed after the last calibration, at first {1}"
        ).format(three_digits(rule["ratio"]), fixed)
    return fixed
