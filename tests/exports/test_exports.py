"""Exports agree with the reading program's formula for every grade, and errors of convention are detected."""

import io
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import cache, reduce
from operator import xor
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from calstation.bench.truth import GradeName, draw_imu
from calstation.errors import CalstationError, ConfigurationError, InputError
from calstation.estimation.common import SampleBlock
from calstation.exports import FORMATS, ExportSource, block_yaml, export_calibration
from calstation.exports.check import check_export
from calstation.exports.source import Files
from calstation.physics import NAMES, PARAMETERS, FloatArray, compensate, compensation, group_matrix, group_vector
from calstation.records import Log, LogMeta
from calstation.results import Result
from tests.helpers import raises_code

RATE = 200.0


def measured(parameters: FloatArray, rate: FloatArray, force: FloatArray) -> FloatArray:
    """Return the output of a unit, shape (n, 6), from the error model of the contract."""
    lever = group_vector(parameters, "inner_lever")
    sensed = force - lever * ((rate**2).sum(axis=1, keepdims=True) - rate**2)
    gyro = rate @ (np.eye(3) + group_matrix(parameters, "gyro_scale", "gyro_misalign")).T
    accel = sensed @ (np.eye(3) + group_matrix(parameters, "accel_scale", "accel_misalign")).T
    accel += group_vector(parameters, "accel_quadratic") * sensed**2 + group_vector(parameters, "accel_bias")
    return np.hstack([gyro + group_vector(parameters, "gyro_bias"), accel])


@cache
def calibrated(grade: GradeName, **sigma_limits: float) -> ExportSource:
    """Return a calibrated unit of a grade with a recording of its turns."""
    random = np.random.default_rng(7)
    imu = draw_imu(grade, random, sample_rate=RATE, output="rate")
    rate, force = random.normal(0.0, 1.0, (500, 3)), random.normal(0.0, 8.0, (500, 3))
    counts = measured(imu.parameters, rate, force) / np.repeat([imu.gyro_lsb, imu.accel_lsb], 3)
    meta = LogMeta.model_validate(
        {
            "site": {"latitude_deg": 34.0, "longitude_deg": 108.0, "height_m": 400.0},
            "imu": {
                **{"serial": "SN-1", "sample_rate_hz": RATE, "output": "rate"},
                **{n: getattr(imu, n) for n in ("gyro_lsb", "accel_lsb", "gyro_arw", "accel_vrw")},
                "gyro_bias_instability": imu.gyro_bias_instability,
            },
            "product": {"name": "unit", "limits": {n: {"sigma_below": v} for n, v in sigma_limits.items()}},
        }
    )
    block = SampleBlock.without_table("", np.arange(500), np.arange(1, 501) / RATE, np.round(counts))
    rows = {
        name: {"value": float(value), "sigma": 1e-6, "unit": p.unit, "stage": "excitation"}
        for name, value, p in zip(NAMES, imu.parameters, PARAMETERS, strict=True)
    }
    result = {"schema": "calstation.result/1", "unit": {"serial": "SN-1"}, "stages": ["excitation"]}
    result |= {"parameters": rows, "outcome": "resolved", "log": {"file": "absent.h5"}}
    return ExportSource.of(Result.from_json(result), Log(Path("turns"), meta, lambda: iter([block])))


def output_of_c(folder: Path, rows: FloatArray) -> FloatArray:
    """Compile ``main.c`` of a folder as C99, and return its output for rows of numbers, shape (n, m)."""
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "main.c", "-o", "main"]
    subprocess.run(command, cwd=folder, check=True, timeout=60)
    text = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
    done = subprocess.run([folder / "main"], input=text, capture_output=True, text=True, check=True, timeout=60)
    return np.loadtxt(io.StringIO(done.stdout))


@pytest.mark.parametrize("grade", get_args(GradeName))
@pytest.mark.parametrize("to", FORMATS)
def test_formula_of_the_reading_program_gives_our_corrected_data(to: str, grade: GradeName) -> None:
    source = calibrated(grade)
    check = check_export(to, FORMATS[to], FORMATS[to].write(source), source)
    assert check.samples == 500
    assert {p.group for p in PARAMETERS if p.name in check.not_expressed} == {
        p.group for p in PARAMETERS if p.group not in FORMATS[to].groups and p.group != "outer_lever"
    }
    if not check.not_expressed:
        assert check.gyro < 1e-9
        assert check.accel < 1e-8
    elif "accel_bias" not in FORMATS[to].groups:
        assert check.accel > 0.5 * np.abs(group_vector(source.parameters, "accel_bias")).max()


def test_check_stands_beside_the_export(tmp_path: Path) -> None:
    export_calibration(calibrated("mems"), "ros", tmp_path / "imu.yaml")
    content = json.loads((tmp_path / "imu.yaml.check.json").read_text(encoding="utf-8"))
    assert (content["format"], content["samples"]) == ("ros", 500)
    assert content["largest"]["gyro"] > 0.0
    assert "gyro_scale_x" in content["not_expressed"]
    assert "gyro_bias_x" not in content["not_expressed"]


def test_loss_beyond_the_limits_is_refused(tmp_path: Path) -> None:
    source = calibrated("mems", gyro_misalign=1e-5)
    with raises_code(ConfigurationError, "export.loss") as caught:
        export_calibration(source, "px4", tmp_path / "imu.params")
    assert {text.values["name"] for text in caught.value.values["names"]} == {
        f"gyro_misalign_{pair}" for pair in ["xy", "xz", "yx", "yz", "zx", "zy"]
    }
    assert not list(tmp_path.iterdir())
    check = export_calibration(source, "px4", tmp_path / "imu.params", allow_loss=True)
    assert list(check.exceeding) == [text.values["name"] for text in caught.value.values["names"]]
    export_calibration(source, "vectornav", tmp_path / "imu.txt")


def test_export_needs_a_recording() -> None:
    result = {"schema": "calstation.result/1", "unit": {"serial": "SN-1"}, "stages": [], "parameters": {}}
    with raises_code(InputError, "export.no_log"):
        ExportSource.of(Result.from_json({**result, "outcome": "resolved", "log": {"file": "absent.h5"}}))


def test_unit_that_corrects_its_own_output_is_not_corrected_twice() -> None:
    log = calibrated("mems").log
    registers = {"old": {}, "new": {"gyro_bias_x": 0.1}, "verified": True}
    result = {"schema": "calstation.result/1", "unit": {"serial": "SN-1"}, "stages": [], "parameters": {}}
    written = Result.from_json({**result, "outcome": "passed", "log": {"file": "absent.h5"}, "registers": registers})
    ExportSource.of(written, log)
    corrected = Log(log.path, log.meta.model_copy(update={"registers": {"gyro_bias_x": 0.0}}), log.blocks)
    with raises_code(InputError, "export.in_registers"):
        ExportSource.of(written, corrected)


def test_unit_without_gyros_is_exported() -> None:
    source = calibrated.__wrapped__("mems")
    (block,) = source.log.blocks()
    block.counts[:, :3] = np.nan
    for to, form in FORMATS.items():
        assert check_export(to, form, form.write(source), source).gyro == 0.0


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c_function_compiles_and_corrects(tmp_path: Path) -> None:
    source = calibrated("mems")
    export_calibration(source, "c", tmp_path / "imu.h")
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "imu.h"\n'
        "int main(void) { double g[3], a[3], w[3], f[3];\n"
        'while (scanf("%lf %lf %lf %lf %lf %lf", g, g + 1, g + 2, a, a + 1, a + 2) == 6) {\n'
        "calstation_correct(g, a, w, f);\n"
        'printf("%.17g %.17g %.17g %.17g %.17g %.17g\\n", w[0], w[1], w[2], f[0], f[1], f[2]); } return 0; }\n',
        encoding="utf-8",
    )
    raw = np.random.default_rng(1).normal(0.0, [1, 1, 1, 9, 9, 9], (50, 6))
    found = output_of_c(tmp_path, raw)
    expected = np.hstack(compensate(compensation(source.parameters), raw[:, :3], raw[:, 3:]))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


def test_kalibr_receives_a_rotation_and_lower_triangular_matrices() -> None:
    imu = block_yaml.load(FORMATS["kalibr"].write(calibrated("mems"))[""])["imu0"]
    rotation = np.array(imu["gyroscopes"]["C_gyro_i"])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) > 0.0
    for sensor in ("gyroscopes", "accelerometers"):
        assert not np.triu(imu[sensor]["M"], 1).any()


@cache
def over_temperature() -> ExportSource:
    """Return a unit with biases, scale factors and a lever arm that depend on the temperature, -35 to 85 °C."""
    single, random = calibrated("mems", gyro_bias=1e-5), np.random.default_rng(11)
    rows = {
        name: {"value": float(value), "sigma": 1e-6, "unit": p.unit, "stage": "temperature"}
        for name, value, p in zip(NAMES, single.parameters, PARAMETERS, strict=True)
    }
    coefficients = {
        p.name: {
            "values": [
                rows[p.name]["value"],
                *(p.prior_sigma * random.normal(size=order) / 60.0 ** np.arange(1, order + 1)),
            ],
            "sigma": [0.0] * (order + 1),
            "unit": p.unit,
        }
        for p in PARAMETERS
        for order in [{"gyro_bias": 3, "accel_bias": 2, "accel_scale": 1, "inner_lever": 1}.get(p.group, 0)]
    }
    coefficients["gyro_bias_x"]["values"] = [rows["gyro_bias_x"]["value"], 1e-6]  # 6e-5 rad/s over the range
    coefficients["gyro_bias_y"]["values"] = [rows["gyro_bias_y"]["value"], 1e-7]
    coefficients["gyro_bias_x"]["rate"] = {"value": 2e-4, "sigma": 1e-6}
    section = {"reference_c": 25.0, "range_c": [-35.0, 85.0], "coefficients": coefficients}
    section |= {"covariance": [], "worst": {}, "points": []}
    result = {"schema": "calstation.result/1", "unit": {"serial": "SN-1"}, "stages": ["temperature"]}
    result |= {"parameters": rows, "outcome": "resolved", "log": {"file": "x.h5"}, "temperature": section}
    (block,) = single.log.blocks()
    warm = replace(block, temperature=np.where(np.arange(500) < 100, 90.0, 45.0))
    return ExportSource.of(Result.from_json(result), Log(Path("turns"), single.log.meta, lambda: iter([warm])))


def test_change_with_temperature_is_named_with_its_size() -> None:
    source = over_temperature()
    check = check_export("vectornav", FORMATS["vectornav"], FORMATS["vectornav"].write(source), source)
    assert check.samples == 400
    assert check.not_expressed["gyro_bias_x(T)"] == pytest.approx(6e-5)
    assert check.not_expressed["gyro_bias_x(dT/dt)"] == 2e-4
    assert {"accel_scale_z(T)", "inner_lever_x", "inner_lever_x(T)"} < check.not_expressed.keys()
    assert check.of_limit["gyro_bias_x(T)"] == pytest.approx(6.0)
    assert check.of_limit["gyro_bias_y(T)"] == pytest.approx(0.6)
    assert "gyro_bias_x(T)" in check.exceeding
    assert "gyro_bias_y(T)" not in check.exceeding


@pytest.mark.parametrize("to", [to for to, form in FORMATS.items() if form.read_over is None])
def test_reference_value_alone_is_refused(to: str, tmp_path: Path) -> None:
    with raises_code(ConfigurationError, "export.loss") as refused:
        export_calibration(over_temperature(), to, tmp_path / "out")
    assert "gyro_bias_x(T) (6 times the limit)" in str(refused.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c_function_over_temperature_compiles_and_corrects(tmp_path: Path) -> None:
    source = over_temperature()
    check = export_calibration(source, "c", tmp_path / "imu.h")
    assert list(check.not_expressed) == ["gyro_bias_x(dT/dt)"]
    assert (check.samples, check.gyro, check.accel) == (
        400,
        pytest.approx(0.0, abs=1e-13),
        pytest.approx(0.0, abs=1e-12),
    )
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "imu.h"\n'
        "int main(void) { double g[3], a[3], w[3] = {0}, f[3] = {0}, t;\n"
        'while (scanf("%lf %lf %lf %lf %lf %lf %lf", g, g + 1, g + 2, a, a + 1, a + 2, &t) == 7) {\n'
        "int done = calstation_correct(g, a, t, w, f);\n"
        'printf("%d %.17g %.17g %.17g ", done, w[0], w[1], w[2]);\n'
        'printf("%.17g %.17g %.17g\\n", f[0], f[1], f[2]); } return 0; }\n',
        encoding="utf-8",
    )
    random = np.random.default_rng(1)
    raw, temperature = random.normal(0.0, [1, 1, 1, 9, 9, 9], (52, 6)), np.linspace(-36.0, 86.0, 52)
    found = output_of_c(tmp_path, np.column_stack([raw, temperature]))
    covered = (temperature >= -35.0) & (temperature <= 85.0)
    assert (found[:, 0] == np.where(covered, 0, -1)).all()
    ours = source.corrected(raw[:, :3], raw[:, 3:], temperature)
    assert ours[2] == np.count_nonzero(covered) < 52
    np.testing.assert_allclose(found[covered, 1:], np.hstack(ours[:2])[covered], rtol=0, atol=1e-13)


def test_numbers_of_yaml_have_a_decimal_point() -> None:
    content = {"a": 1e-05, "b": [[-2e-07, 0.5], [1.5e-09, 3e16]], "c": "1e-05", "d": False, "e": 4}
    text = block_yaml.dump(content, "")
    assert text.decode().splitlines()[:2] == ["a: 1.0e-05", "b: [[-2.0e-07, 0.5], [1.5e-09, 3.0e+16]]"]
    assert block_yaml.load(text) == content


def test_noise_has_the_units_of_the_reading_program() -> None:
    source = calibrated("tactical")
    arw, instability = source.imu.gyro_arw, source.imu.gyro_bias_instability
    imu = block_yaml.load(FORMATS["kalibr"].write(source)[""])["imu0"]
    assert imu["gyroscope_noise_density"] == arw
    assert imu["gyroscope_random_walk"] * np.sqrt(1000.0 / 3.0) == pytest.approx(instability)
    ros = block_yaml.load(FORMATS["ros"].write(source)[""])["/**"]["ros__parameters"]
    assert ros["angular_velocity_covariance"][4] == pytest.approx(arw**2 * RATE)


# Errors of convention: each changes the content of a correct export, and the check must reject the result.

Edit = Callable[[Any], Any]


def transpose(rows: list[list[float]]) -> list[list[float]]:
    return np.array(rows).T.tolist()


def inverse(rows: list[list[float]]) -> list[list[float]]:
    return np.linalg.inv(np.array(rows)).tolist()


def flat(edit: Edit) -> Edit:
    """Apply an edit to a matrix in row order."""
    return lambda numbers: np.ravel(edit(np.reshape(numbers, (3, 3)).tolist())).tolist()


def negated(numbers: Any) -> Any:
    return (-np.array(numbers)).tolist()


def in_degrees(numbers: Any) -> Any:
    return np.rad2deg(numbers).tolist()


def in_g(numbers: Any) -> Any:
    return (np.array(numbers) / 9.80665).tolist()


def axes_of_ned(numbers: list[float]) -> list[float]:
    """Return a vector in axes x front, y right, z down."""
    x, y, z = numbers
    return [y, x, -z]


def rotated(numbers: Any) -> Any:
    return np.roll(numbers, 1, axis=0).tolist()


def without_identity(rows: list[list[float]]) -> list[list[float]]:
    return (np.array(rows) - np.eye(3)).tolist()


def as_fraction(percent: Any) -> Any:
    return (np.array(percent) / 100.0).tolist()


def one_minus(rows: list[list[float]]) -> list[list[float]]:
    """Return I - M for I + M."""
    return (2.0 * np.eye(3) - np.array(rows)).tolist()


def yaml_error(*path: str, edit: Edit) -> Callable[[Files], Files]:
    def inject(files: Files) -> Files:
        content = block_yaml.load(files[""])
        section = content
        for key in path[:-1]:
            section = section[key]
        section[path[-1]] = edit(section[path[-1]])
        return {"": block_yaml.dump(content, "")}

    return inject


def exchanged_kalibr(files: Files) -> Files:
    content = block_yaml.load(files[""])
    gyroscopes = content["imu0"]["gyroscopes"]
    gyroscopes["M"] = (np.array(gyroscopes["C_gyro_i"]) @ gyroscopes["M"]).tolist()
    gyroscopes["C_gyro_i"] = np.eye(3).tolist()
    return {"": block_yaml.dump(content, "")}


def exchanged_levers(files: Files) -> Files:
    content = block_yaml.load(files[""])
    accelerometers = content["imu0"]["accelerometers"]
    accelerometers["rx_i"], accelerometers["ry_i"] = accelerometers["ry_i"], accelerometers["rx_i"]
    return {"": block_yaml.dump(content, "")}


def bias_before_the_matrix(files: Files) -> Files:
    content = block_yaml.load(files[""])
    parameters = content["/**"]["ros__parameters"]
    matrix = np.reshape(parameters["imu/intrinsics/accel/sm"], (3, 3))
    key = "imu/intrinsics/accel/bias"
    parameters[key] = np.linalg.solve(matrix, parameters[key]).tolist()
    return {"": block_yaml.dump(content, "")}


def parameter_error(pattern: str, edit: Edit) -> Callable[[Files], Files]:
    """Edit the three numbers of the parameters of an autopilot that match a pattern, in the order of the file."""
    line = re.compile(rf"^(.*{pattern}[,\t])([^\t\n]+)(.*)$", re.MULTILINE)

    def inject(files: Files) -> Files:
        text = files[""].decode()
        values = iter(edit([float(match[2]) for match in line.finditer(text)]))
        return {"": line.sub(lambda match: f"{match[1]}{next(values)!r}{match[3]}", text).encode()}

    return inject


def scale_before_offset(files: Files) -> Files:
    """Convert offsets for (measured - offset) factor to those for measured factor - offset."""
    numbers = [float(n) for n in re.findall(r"ACCSCAL_.,(.*)", files[""].decode())]
    return parameter_error("INS_ACCOFFS_.", lambda offsets: (np.array(offsets) * numbers).tolist())(files)


def register_error(
    register: int, edit: Callable[[FloatArray, FloatArray], tuple[Any, Any]]
) -> Callable[[Files], Files]:
    def inject(files: Files) -> Files:
        lines = files[""].decode().splitlines()
        for number, line in enumerate(lines):
            name, found, *numbers = line[1:].partition("*")[0].split(",") + [""] * (line.count(",") == 0)
            if found == str(register):
                values = np.array(numbers, dtype=float)
                matrix, bias = edit(values[:9].reshape(3, 3), values[9:])
                text = ",".join([name, found, *(f"{v:.12g}" for v in (*np.ravel(matrix), *bias))])
                lines[number] = f"${text}*{reduce(xor, text.encode()):02X}"
        return {"": "\r\n".join(lines).encode()}

    return inject


def json_error(sensor: str, key: str, edit: Edit) -> Callable[[Files], Files]:
    def inject(files: Files) -> Files:
        content = json.loads(files[""])
        content["SN-1"][sensor][key] = edit(content["SN-1"][sensor][key])
        return {**files, "": json.dumps(content).encode()}

    return inject


def mat_error(key: str, edit: Edit) -> Callable[[Files], Files]:
    def inject(files: Files) -> Files:
        content = {k: v for k, v in loadmat(io.BytesIO(files[".mat"])).items() if not k.startswith("__")}
        stream = io.BytesIO()
        savemat(stream, {**content, key: edit(content[key])})
        return {**files, ".mat": stream.getvalue()}

    return inject


def c_error(constant: str, edit: Edit) -> Callable[[Files], Files]:
    found = re.compile(rf"(calstation_{constant}\[\d\] = {{)(.*)(}};)")

    def inject(files: Files) -> Files:
        text = files[""].decode()
        return {
            "": found.sub(lambda m: m[1] + ", ".join(map(repr, edit(json.loads(f"[{m[2]}]")))) + m[3], text).encode()
        }

    return inject


def xml_error(pattern: str, replacement: str) -> Callable[[Files], Files]:
    return lambda files: {"": re.sub(pattern, replacement, files[""].decode()).encode()}


GYRO, ACCEL = ("imu0", "gyroscopes"), ("imu0", "accelerometers")
PARAMETERS_OF_ROS = ("/**", "ros__parameters")
SM, BIAS, GYRO_BIAS = (f"imu/intrinsics/{name}" for name in ("accel/sm", "accel/bias", "gyro/bias"))
INJECTED: list[tuple[str, str, Callable[[Files], Files]]] = [
    ("kalibr", "accelerometer matrix transposed", yaml_error(*ACCEL, "M", edit=transpose)),
    ("kalibr", "accelerometer matrix inverted", yaml_error(*ACCEL, "M", edit=inverse)),
    ("kalibr", "accelerometer matrix with the signs of the correction", yaml_error(*ACCEL, "M", edit=one_minus)),
    ("kalibr", "accelerometer matrix without identity", yaml_error(*ACCEL, "M", edit=without_identity)),
    ("kalibr", "gyro matrix transposed", yaml_error(*GYRO, "M", edit=transpose)),
    ("kalibr", "gyro matrix inverted", yaml_error(*GYRO, "M", edit=inverse)),
    ("kalibr", "rotation from the gyros to the IMU", yaml_error(*GYRO, "C_gyro_i", edit=transpose)),
    ("kalibr", "rotation on the other side", exchanged_kalibr),
    ("kalibr", "no rotation", yaml_error(*GYRO, "C_gyro_i", edit=lambda _: np.eye(3).tolist())),
    ("kalibr", "lever with the other sign", yaml_error(*ACCEL, "ry_i", edit=negated)),
    ("kalibr", "levers of two axes exchanged", exchanged_levers),
    ("kalibr", "lever in mm", yaml_error(*ACCEL, "rx_i", edit=lambda r: (1e3 * np.array(r)).tolist())),
    ("ros", "matrix in column order", yaml_error(*PARAMETERS_OF_ROS, SM, edit=flat(transpose))),
    ("ros", "matrix of the errors", yaml_error(*PARAMETERS_OF_ROS, SM, edit=flat(inverse))),
    ("ros", "bias with the other sign", yaml_error(*PARAMETERS_OF_ROS, BIAS, edit=negated)),
    ("ros", "bias before the matrix", bias_before_the_matrix),
    ("ros", "bias in g", yaml_error(*PARAMETERS_OF_ROS, BIAS, edit=in_g)),
    ("ros", "gyro bias in degrees", yaml_error(*PARAMETERS_OF_ROS, GYRO_BIAS, edit=in_degrees)),
    ("ros", "gyro bias with the other sign", yaml_error(*PARAMETERS_OF_ROS, GYRO_BIAS, edit=negated)),
    ("ros", "bias in front-right-down axes", yaml_error(*PARAMETERS_OF_ROS, BIAS, edit=axes_of_ned)),
    ("px4", "offset with the other sign", parameter_error("CAL_ACC0_.OFF", negated)),
    ("px4", "scale instead of its inverse", parameter_error("CAL_ACC0_.SCALE", lambda v: (1 / np.array(v)).tolist())),
    ("px4", "scale in ppm", parameter_error("CAL_ACC0_.SCALE", lambda v: (1e6 * (np.array(v) - 1)).tolist())),
    ("px4", "gyro offset in degrees", parameter_error("CAL_GYRO0_.OFF", in_degrees)),
    ("px4", "offset in front-right-down axes", parameter_error("CAL_GYRO0_.OFF", axes_of_ned)),
    ("ardupilot", "offset with the other sign", parameter_error("INS_ACCOFFS_.", negated)),
    ("ardupilot", "scale of the error", parameter_error("INS_ACCSCAL_.", lambda v: (np.array(v) - 1).tolist())),
    ("ardupilot", "scale before the offset", scale_before_offset),
    ("ardupilot", "gyro offset with the other sign", parameter_error("INS_GYROFFS_.", negated)),
    ("ardupilot", "offsets of the axes in another order", parameter_error("INS_GYROFFS_.", rotated)),
    ("vectornav", "matrix in column order", register_error(84, lambda c, b: (c.T, b))),
    ("vectornav", "matrix of the errors", register_error(25, lambda c, b: (np.linalg.inv(c), b))),
    ("vectornav", "bias with the other sign", register_error(25, lambda c, b: (c, -b))),
    ("vectornav", "bias after the matrix", register_error(84, lambda c, b: (c, c @ b))),
    ("vectornav", "bias in degrees", register_error(84, lambda c, b: (c, np.rad2deg(b)))),
    ("vectornav", "axes in another order", register_error(25, lambda c, b: (np.roll(c, 1, axis=0), b))),
    (
        "matlab",
        "misalignment as a fraction",
        json_error("Gyroscope", "AxesMisalignment", as_fraction),
    ),
    ("matlab", "matrix transposed", json_error("Accelerometer", "AxesMisalignment", transpose)),
    ("matlab", "bias with the other sign", json_error("Gyroscope", "ConstantBias", negated)),
    ("matlab", "accelerometer bias with the sign of the unit", json_error("Accelerometer", "ConstantBias", negated)),
    ("matlab", "bias in g", json_error("Accelerometer", "ConstantBias", in_g)),
    ("matlab", "matrix for columns of samples", mat_error("gyro_A", np.transpose)),
    ("matlab", "b before the matrix", mat_error("accel_b", lambda b: 1.01 * b)),
    ("matlab", "b with the other sign", mat_error("gyro_b", lambda b: -b)),
    ("c", "matrix in column order", c_error("gyro_matrix", flat(transpose))),
    ("c", "matrix of the errors", c_error("accel_matrix", flat(inverse))),
    ("c", "bias with the other sign", c_error("accel_bias", negated)),
    ("c", "lever with the other sign", c_error("inner_lever", negated)),
    ("c", "quadratic in 1/g", c_error("accel_quadratic", lambda k: (np.array(k) * 9.80665).tolist())),
    ("gazebo", "bias with a random sign", xml_error("<mean>(.*)</mean>", r"<mean>0</mean><bias_mean>\1</bias_mean>")),
    ("gazebo", "bias with the other sign", xml_error("<mean>-?", "<mean>1")),
    ("gazebo", "axes exchanged", xml_error("<(/?)x>", r"<\1w>")),
]


def test_at_least_40_errors_are_injected() -> None:
    assert len(INJECTED) >= 40
    assert {to for to, _, _ in INJECTED} == set(FORMATS)


@pytest.mark.parametrize(("to", "error", "inject"), INJECTED, ids=[f"{to}: {error}" for to, error, _ in INJECTED])
@pytest.mark.parametrize("grade", get_args(GradeName))
def test_error_of_convention_is_detected(
    to: str, error: str, inject: Callable[[Files], Files], grade: GradeName
) -> None:
    source = calibrated(grade)
    files = FORMATS[to].write(source)
    wrong = inject(files)
    assert wrong != files
    with raises_code(CalstationError, "export.contradicts"):
        check_export(to, FORMATS[to], wrong, source)


def test_negative_readings_of_the_simulated_sensor_are_the_output_of_the_unit() -> None:
    """`imuSensor` in ENU: totalAcc = −acceleration + g, in sensor axes; then AxesMisalignment and ConstantBias."""
    source = calibrated("mems")
    (sensors,) = json.loads(FORMATS["matlab"].write(source)[""]).values()
    section = sensors["Accelerometer"]
    acceleration, gravity = np.array([[0.3, -0.2, 0.1]]), np.array([[0.0, 0.0, -9.8]])
    readings = (gravity - acceleration) @ (np.array(section["AxesMisalignment"]) / 100.0).T + section["ConstantBias"]
    force = acceleration - gravity
    p = source.parameters
    gain = np.eye(3) + group_matrix(p, "accel_scale", "accel_misalign")
    np.testing.assert_allclose(-readings, force @ gain.T + group_vector(p, "accel_bias"), rtol=1e-12)
