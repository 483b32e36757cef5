"""A C header with a function that corrects a sample with the whole error model; C99 without dependencies.

The function computes, with arrays of three numbers,

    rate  = G (gyro - gyro_bias)                        G and A are the inverse matrices, in row order
    force = A (accel - accel_bias - quadratic force²)   by three iterations
    force += inner_lever (|rate|² - rate²)              to the reference point of the IMU
"""

import re

import numpy as np

from calstation.exports.source import Corrector, ExportFormat, ExportSource, Files
from calstation.physics import FloatArray

_TEXT = """\
/* Correction of the IMU {serial}, from calstation. Axes of the IMU's body, SI units:
   gyro and rate in rad/s, accel and force in m/s^2. */
#ifndef CALSTATION_IMU_H
#define CALSTATION_IMU_H

static const double calstation_gyro_matrix[9] = {{{gyro_matrix}}};
static const double calstation_gyro_bias[3] = {{{gyro_bias}}};
static const double calstation_accel_matrix[9] = {{{accel_matrix}}};
static const double calstation_accel_bias[3] = {{{accel_bias}}};
static const double calstation_accel_quadratic[3] = {{{accel_quadratic}}};
static const double calstation_inner_lever[3] = {{{inner_lever}}};

static inline void calstation_correct(const double gyro[3], const double accel[3], double rate[3], double force[3])
{{
    double square = 0.0;
    for (int i = 0; i < 3; i++) {{
        rate[i] = 0.0;
        force[i] = 0.0;
        for (int j = 0; j < 3; j++) {{
            rate[i] += calstation_gyro_matrix[3 * i + j] * (gyro[j] - calstation_gyro_bias[j]);
            force[i] += calstation_accel_matrix[3 * i + j] * (accel[j] - calstation_accel_bias[j]);
        }}
        square += rate[i] * rate[i];
    }}
    for (int k = 0; k < 3; k++) {{
        double last[3] = {{force[0], force[1], force[2]}};
        for (int i = 0; i < 3; i++) {{
            force[i] = 0.0;
            for (int j = 0; j < 3; j++)
                force[i] += calstation_accel_matrix[3 * i + j]
                    * (accel[j] - calstation_accel_bias[j] - calstation_accel_quadratic[j] * last[j] * last[j]);
        }}
    }}
    for (int i = 0; i < 3; i++)
        force[i] += calstation_inner_lever[i] * (square - rate[i] * rate[i]);
}}

#endif
"""
#: Declarations of the constants.
_CONSTANT = re.compile(r"double calstation_(\w+)\[\d\] = \{(.*)\};")


def _write(source: ExportSource) -> Files:
    constants = {
        "gyro_matrix": np.linalg.inv(source.matrix("gyro")).ravel().tolist(),
        "accel_matrix": np.linalg.inv(source.matrix("accel")).ravel().tolist(),
        **{n: source.vector(n) for n in ("gyro_bias", "accel_bias", "accel_quadratic", "inner_lever")},
    }
    numbers = {name: ", ".join(map(repr, values)) for name, values in constants.items()}
    serial = source.serial.replace("*/", "* /")
    return {"": _TEXT.format(serial=serial, **numbers).encode()}


def _read(files: Files) -> Corrector:
    found = _CONSTANT.findall(files[""].decode())
    constants = {name: np.array([float(number) for number in numbers.split(",")]) for name, numbers in found}
    gyro_matrix, accel_matrix = (constants[f"{sensor}_matrix"].reshape(3, 3) for sensor in ("gyro", "accel"))

    def correct(gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute what the C function computes; a test compiles and runs the function itself."""
        rate = np.einsum("ij,nj->ni", gyro_matrix, gyro - constants["gyro_bias"])
        linear = accel - constants["accel_bias"]
        force = np.einsum("ij,nj->ni", accel_matrix, linear)
        for _ in range(3):
            force = np.einsum("ij,nj->ni", accel_matrix, linear - constants["accel_quadratic"] * force**2)
        square = np.einsum("ni,ni->n", rate, rate)[:, None]
        return rate, force + constants["inner_lever"] * np.nan_to_num(square - rate**2)

    return correct


_LINEAR = ("gyro_bias", "gyro_scale", "gyro_misalign", "accel_bias", "accel_scale", "accel_misalign")

FORMAT = ExportFormat(frozenset({*_LINEAR, "accel_quadratic", "inner_lever"}), _write, _read)
