"""A C header with a function that corrects a sample with the whole error model; C99 without dependencies.

The function computes, with arrays of three numbers,

    rate  = G (gyro - gyro_bias)                        G and A are the inverse matrices, in row order
    force = A (accel - accel_bias - quadratic force²)   by three iterations
    force += inner_lever (|rate|² - rate²)              to the reference point of the IMU

Over temperature, it evaluates the polynomials of all parameters at the temperature of the sample, and subtracts the
errors of the last rate and force from the output, in five iterations; G and A are not needed.
"""

import json
import re

import numpy as np

from calstation.exports.source import Corrector, ExportFormat, ExportSource, Files, TemperatureCorrector
from calstation.physics import NAMES, PARAMETERS, FloatArray

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
_OVER = """\
/* Correction of the IMU {serial} over temperature, from calstation. Axes of the IMU's body, SI units:
   gyro and rate in rad/s, accel and force in m/s^2; temperature of the unit's own sensor in degrees Celsius.
   The function returns 0, or -1 and no result at a temperature below calstation_low or above calstation_high: the
   calibration covers no others. A row of a table is a polynomial of temperature - calstation_reference. */
#ifndef CALSTATION_IMU_H
#define CALSTATION_IMU_H

static const double calstation_reference = {reference};
static const double calstation_low = {low};
static const double calstation_high = {high};
{tables}

static inline void calstation_evaluate(int count, const double table[][{terms}], double x, double *values)
{{
    for (int i = 0; i < count; i++) {{
        values[i] = 0.0;
        for (int k = {terms} - 1; k >= 0; k--)
            values[i] = values[i] * x + table[i][k];
    }}
}}

static inline int calstation_correct(
    const double gyro[3], const double accel[3], double temperature, double rate[3], double force[3])
{{
    const double x = temperature - calstation_reference;
    double gyro_bias[3], gyro_errors[9], accel_bias[3], accel_errors[9], quadratic[3], lever[3], square = 0.0;
    if (!(temperature >= calstation_low && temperature <= calstation_high))
        return -1;
    calstation_evaluate(3, calstation_gyro_bias, x, gyro_bias);
    calstation_evaluate(9, calstation_gyro_errors, x, gyro_errors);
    calstation_evaluate(3, calstation_accel_bias, x, accel_bias);
    calstation_evaluate(9, calstation_accel_errors, x, accel_errors);
    calstation_evaluate(3, calstation_accel_quadratic, x, quadratic);
    calstation_evaluate(3, calstation_inner_lever, x, lever);
    for (int i = 0; i < 3; i++) {{
        rate[i] = gyro[i];
        force[i] = accel[i];
    }}
    for (int k = 0; k < 5; k++) {{
        const double last_rate[3] = {{rate[0], rate[1], rate[2]}}, last[3] = {{force[0], force[1], force[2]}};
        for (int i = 0; i < 3; i++) {{
            rate[i] = gyro[i] - gyro_bias[i];
            force[i] = accel[i] - accel_bias[i] - quadratic[i] * last[i] * last[i];
            for (int j = 0; j < 3; j++) {{
                rate[i] -= gyro_errors[3 * i + j] * last_rate[j];
                force[i] -= accel_errors[3 * i + j] * last[j];
            }}
        }}
    }}
    for (int i = 0; i < 3; i++)
        square += rate[i] * rate[i];
    for (int i = 0; i < 3; i++)
        force[i] += lever[i] * (square - rate[i] * rate[i]);
    return 0;
}}

#endif
"""
#: Declarations of the reference temperature and the range, and of the polynomials.
_NUMBER = re.compile(r"double calstation_(\w+) = (.*);")
_TABLE = re.compile(r"double calstation_(\w+)\[\d\]\[\d+\] = (.*);")
_ITERATIONS = 5


def _write(source: ExportSource) -> Files:
    if source.temperature is not None:
        return {"": _write_over(source).encode()}
    constants = {
        "gyro_matrix": np.linalg.inv(source.matrix("gyro")).ravel().tolist(),
        "accel_matrix": np.linalg.inv(source.matrix("accel")).ravel().tolist(),
        **{n: source.vector(n) for n in ("gyro_bias", "accel_bias", "accel_quadratic", "inner_lever")},
    }
    numbers = {name: ", ".join(map(repr, values)) for name, values in constants.items()}
    serial = source.serial.replace("*/", "* /")
    return {"": _TEXT.format(serial=serial, **numbers).encode()}


def _write_over(source: ExportSource) -> str:
    """Return the header for a calibration over temperature."""
    over = source.temperature
    if over is None:
        raise ValueError("constant parameters")
    terms = max(len(row.values) for row in over.coefficients.values()) if over.coefficients else 1
    polynomials = np.zeros((len(NAMES), terms))
    polynomials[:, 0] = source.parameters
    for name, row in over.coefficients.items():
        polynomials[NAMES.index(name), : len(row.values)] = row.values
    tables = {
        f"{sensor}_{kind}": np.zeros((rows, terms))
        for sensor in ("gyro", "accel")
        for kind, rows in (("bias", 3), ("errors", 9))
    }
    tables |= {"accel_quadratic": np.zeros((3, terms)), "inner_lever": np.zeros((3, terms))}
    for polynomial, p in zip(polynomials, PARAMETERS, strict=True):
        if p.group in tables:
            tables[p.group][p.row] = polynomial
        elif p.group.endswith(("scale", "misalign")):
            tables[f"{p.sensor}_errors"][3 * p.row + p.column] = polynomial
    rows = {name: json.dumps(table.tolist()).replace("[", "{").replace("]", "}") for name, table in tables.items()}
    text = "\n".join(
        f"static const double calstation_{name}[{len(tables[name])}][{terms}] = {row};" for name, row in rows.items()
    )
    low, high = over.range_c
    numbers = {"reference": repr(over.reference_c), "low": repr(low), "high": repr(high)}
    return _OVER.format(serial=source.serial.replace("*/", "* /"), tables=text, terms=terms, **numbers)


def _read_over(files: Files) -> TemperatureCorrector:
    text = files[""].decode()
    reference, low, high = (float(value) for _, value in _NUMBER.findall(text))
    tables_in_text = _TABLE.findall(text)
    tables = {name: np.array(json.loads(rows.replace("{", "[").replace("}", "]"))) for name, rows in tables_in_text}

    def correct(gyro: FloatArray, accel: FloatArray, temperature: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute what the C function computes; a test compiles and runs the function itself."""
        known = (temperature >= low) & (temperature <= high)
        powers = np.vander(temperature - reference, next(iter(tables.values())).shape[1], increasing=True)
        values = {name: powers @ table.T for name, table in tables.items()}
        gyro_errors, accel_errors = (values[f"{sensor}_errors"].reshape(-1, 3, 3) for sensor in ("gyro", "accel"))
        rate, force = gyro, accel
        for _ in range(_ITERATIONS):
            quadratic = values["accel_quadratic"] * force**2
            rate = gyro - values["gyro_bias"] - np.einsum("nij,nj->ni", gyro_errors, rate)
            force = accel - values["accel_bias"] - quadratic - np.einsum("nij,nj->ni", accel_errors, force)
        square = np.einsum("ni,ni->n", rate, rate)[:, None]
        force = force + values["inner_lever"] * np.nan_to_num(square - rate**2)
        return np.where(known[:, None], rate, np.nan), np.where(known[:, None], force, np.nan)

    return correct


def _read(files: Files) -> Corrector:
    constants_in_text = _CONSTANT.findall(files[""].decode())
    constants = {
        name: np.array([float(number) for number in numbers.split(",")]) for name, numbers in constants_in_text
    }
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

FORMAT = ExportFormat(frozenset({*_LINEAR, "accel_quadratic", "inner_lever"}), _write, _read, _read_over)
