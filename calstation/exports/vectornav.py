r"""Commands that write a VectorNav's compensation: registers 25 (accelerometers) and 84 (gyros), and the flash.

The unit corrects with 12 numbers per register, C in row order and then B (VN-100 interface control document):

    output = C (measured - B)

Each command ends with the XOR of the characters between ``$`` and ``*``, and ``\r\n``.
"""

from functools import reduce
from operator import xor

import numpy as np

from calstation.exports.source import Corrector, ExportFormat, ExportSource, Files
from calstation.physics import FloatArray

_REGISTERS = {"accel": 25, "gyro": 84}
#: Writes the settings to the flash.
_COMMIT = "VNWNV"


def _command(text: str) -> str:
    return f"${text}*{reduce(xor, text.encode()):02X}\r\n"


def _write(source: ExportSource) -> Files:
    commands = []
    for sensor, register in _REGISTERS.items():
        numbers = [*np.linalg.inv(source.matrix(sensor)).ravel(), *source.vector(f"{sensor}_bias")]
        commands.append(_command(f"VNWRG,{register}," + ",".join(f"{number:.12g}" for number in numbers)))
    return {"": "".join([*commands, _command(_COMMIT)]).encode()}


def _read(files: Files) -> Corrector:
    matrices: dict[int, tuple[FloatArray, FloatArray]] = {}
    for line in files[""].decode().splitlines():
        text, _, checksum = line.removeprefix("$").partition("*")
        if int(checksum, 16) != reduce(xor, text.encode()):
            raise ValueError(f"checksum of {line}")
        if text.startswith("VNWRG,"):
            _, register, *numbers = text.split(",")
            values = np.array(numbers, dtype=np.float64)
            matrices[int(register)] = values[:9].reshape(3, 3), values[9:]

    def correct(gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
        measured = {"accel": accel, "gyro": gyro}
        output = {}
        for sensor, register in _REGISTERS.items():
            matrix, bias = matrices[register]
            output[sensor] = (measured[sensor] - bias) @ matrix.T
        return output["gyro"], output["accel"]

    return correct


FORMAT = ExportFormat(
    frozenset({"gyro_bias", "gyro_scale", "gyro_misalign", "accel_bias", "accel_scale", "accel_misalign"}),
    _write,
    _read,
)
