"""The correction of autopilots: an offset, then a factor per axis for the accelerometers, an offset for the gyros.

PX4 (`Accelerometer::Correct`, `Gyroscope::Correct`) and ArduPilot (`_rotate_and_correct_accel`) correct in the axes of
the sensor, before they rotate the samples to the axes of the vehicle:

    accel = (measured - offset) factor          gyro = measured - offset
"""

from collections.abc import Callable, Mapping

import numpy as np

from calstation.exports.source import Corrector, ExportFormat, ExportSource, Files
from calstation.physics import AXES, FloatArray

#: Names of the parameters of an autopilot; "{axis}" is X, Y or Z.
Names = Mapping[str, str]


def autopilot_format(
    names: Names, dump: Callable[[Mapping[str, float], str], str], load: Callable[[str], Mapping[str, float]]
) -> ExportFormat:
    """Return the format of an autopilot.

    Parameters
    ----------
    names : names of the parameters ``accel_offset``, ``accel_factor`` and ``gyro_offset``
    dump : returns the text of the parameters by name, for a unit
    load : reads the parameters from the text
    """

    def write(source: ExportSource) -> Files:
        factors = [1.0 / (1.0 + scale) for scale in source.vector("accel_scale")]
        values = {
            "accel_offset": source.vector("accel_bias"),
            "accel_factor": factors,
            "gyro_offset": source.vector("gyro_bias"),
        }
        parameters = {
            names[kind].format(axis=axis.upper()): value
            for kind, three in values.items()
            for axis, value in zip(AXES, three, strict=True)
        }
        return {"": dump(parameters, source.serial).encode()}

    def read(files: Files) -> Corrector:
        parameters = load(files[""].decode())
        accel_offset, factor, gyro_offset = (
            np.array([parameters[names[kind].format(axis=axis.upper())] for axis in AXES])
            for kind in ("accel_offset", "accel_factor", "gyro_offset")
        )

        def correct(gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
            return gyro - gyro_offset, (accel - accel_offset) * factor

        return correct

    return ExportFormat(frozenset({"gyro_bias", "accel_bias", "accel_scale"}), write, read)
