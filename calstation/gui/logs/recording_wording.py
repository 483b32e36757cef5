"""What makes a recording of the methods without a table worthless, and words inside such sentences.

The solvers' English sentences, each known by its pattern; `log_wording` finds and translates them.
"""

import re

from PySide6.QtCore import QCoreApplication

from calstation.messages.marked import QT_TRANSLATE_NOOP

#: A stage's name may stand before them; the page that shows them has named the method already.
RECORDINGS: tuple[str, ...] = (
    QT_TRANSLATE_NOOP("logs", "{0} is frozen: one value all through; check its encoder"),
    QT_TRANSLATE_NOOP(
        "logs",
        "{0} is frozen: one value from sample {1} to {2} ({3} s); check the unit and its cable and record again",
    ),
    QT_TRANSLATE_NOOP(
        "logs", "{0} is frozen for {1} s from {2} s on; check the unit and its cable and record again"
    ),
    QT_TRANSLATE_NOOP("logs", "{0} is frozen from sample {1} to {2}; check the unit and its cable"),
    QT_TRANSLATE_NOOP(
        "logs",
        "the gyros' units are wrong by a factor: their noise looks like motion, and rests appear where rates are "
        "multiplied by {0} ({1}); correct imu.gyro_lsb or imu.output",
    ),
    QT_TRANSLATE_NOOP(
        "logs", "no rest of {0} s or more in {1} s of samples; lay the unit still at every position"
    ),
    QT_TRANSLATE_NOOP("logs", "no rest of {0} s to check at; lay the body still once"),
    QT_TRANSLATE_NOOP(
        "logs",
        "no motion: all {0} rests lie the same way up; turn the unit to other positions between rests",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "accelerometers at rest show {0} m/s² where gravity is {1}: units wrong by a factor of {2} ({3}); "
        "correct imu.accel_lsb or imu.output",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "accelerometers at rest show {0} m/s² where gravity is {1}: units wrong by a factor of {2}; "
        "correct imu.accel_lsb or imu.output",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "the gyros do not see the motions: {0}° where gravity turned by {1}° (samples {2} to {3}); "
        "check that they are alive and imu.gyro_lsb",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "the gyro's axes are not the accelerometer's: motions agree with gravity where {0}; "
        "correct the columns or their signs",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "the gyros' units are wrong by a factor: motions agree with gravity where rates are multiplied by "
        "{0} ({1}); correct imu.gyro_lsb or imu.output",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "the gyros' units are wrong by a factor: motions agree with gravity where rates are multiplied by "
        "{0}; correct imu.gyro_lsb or imu.output",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "gyros and accelerometers contradict each other in too many of {0} motions, most by {1}° in "
        "samples {2} to {3}; check gaps, saturation and columns",
    ),
    QT_TRANSLATE_NOOP(
        "logs", "imu{0}: {1} s of synchronous samples with the primary; record both for {2} s or more"
    ),
    QT_TRANSLATE_NOOP("logs", "no motion in the recording; {0} about all axes"),
    QT_TRANSLATE_NOOP(
        "logs",
        "hardly any motion about {0} ({1} of that about others), so nothing is determined there; {2} about {3} too",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "imu{0}: its {1} measures {2} times what the primary's does: units wrong by a factor; "
        "correct imu{3}.{4}_lsb or .output",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "imu{0}: the axes of its {1} are a mirror image of the primary's; two columns are swapped or one has the "
        "wrong sign",
    ),
    QT_TRANSLATE_NOOP(
        "logs", "imu{0}: its gyro and accelerometer lie {1}° apart; columns of one are swapped"
    ),
    QT_TRANSLATE_NOOP("logs", "imu{0}: the motion does not determine what is asked for; turn about all axes"),
    QT_TRANSLATE_NOOP(
        "logs",
        "cross_calibration needs a second IMU; add [imu2] to the configuration and its columns to the log",
    ),
    QT_TRANSLATE_NOOP("logs", "holds one IMU; add [imu2] to the configuration and its columns to the log"),
    QT_TRANSLATE_NOOP("logs", "{0} s of motion where {1} are asked for"),
    QT_TRANSLATE_NOOP(
        "logs", "no joint angles; add the columns joint_x_deg, joint_y_deg and joint_z_deg of the gimbal"
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "no turn of one joint from zero between rests of {0} s ({1} motions found); "
        "bring the joints to zero, rest, turn one axis, rest",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "joint_{0} was turned but gyro_{1} saw it (samples {2} to {3}); axes are swapped, correct the columns",
    ),
    QT_TRANSLATE_NOOP(
        "logs", "gyro_{0} and joint_{1} turn opposite ways (samples {2} to {3}); correct a sign"
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "gyro_{0} turned {1} times as far as joint_{2} (samples {3} to {4}): units wrong by a factor; "
        "correct imu.gyro_lsb or the joints' columns",
    ),
    QT_TRANSLATE_NOOP(
        "logs",
        "turned about {0} the joints drift by {1}″ after {2} turns and drifted by {3}″ at first: the rates were "
        "not corrected by K; correct them, or the schedule's gain and order",
    ),
)

_PHRASES: tuple[str, ...] = (
    QT_TRANSLATE_NOOP("logs", "g instead of m/s²"),
    QT_TRANSLATE_NOOP("logs", "mg instead of m/s²"),
    QT_TRANSLATE_NOOP("logs", "m/s² instead of g"),
    QT_TRANSLATE_NOOP("logs", "mm/s² instead of m/s²"),
    QT_TRANSLATE_NOOP("logs", "°/s instead of rad/s"),
    QT_TRANSLATE_NOOP("logs", "rad/s instead of °/s"),
    QT_TRANSLATE_NOOP("logs", "mrad/s instead of rad/s"),
    QT_TRANSLATE_NOOP("logs", "m°/s instead of rad/s"),
    QT_TRANSLATE_NOOP("logs", "turn the body"),
    QT_TRANSLATE_NOOP("logs", "tilt or shake the body"),
)
_AXIS_IS = re.compile(r"gyro_([xyz]) is (−?)gyro_([xyz])")


def word_value(value: str) -> str:
    """A value of such a sentence that is words itself; anything else as it is."""
    if value in _PHRASES:
        return QCoreApplication.translate("logs", value)
    parts = [_AXIS_IS.fullmatch(part) for part in value.split(" and ")]
    if all(parts):
        said = (
            QCoreApplication.translate("logs", "gyro_{0} is {1}gyro_{2}").format(*p.groups())
            for p in parts
            if p is not None
        )
        return QCoreApplication.translate("logs", " and ").join(said)
    return value
