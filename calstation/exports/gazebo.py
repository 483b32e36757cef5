"""The section ``<imu>`` of an SDF model, with which Gazebo simulates the unit.

Gazebo adds to each axis (`GaussianNoiseModel::ApplyImpl`)

    measured = true + white noise about `mean` + a bias that changes with time

and gives the bias from `bias_mean` a random sign; the unit's bias is therefore its `mean`.
"""

from xml.etree import ElementTree

import numpy as np

from calstation.exports.source import BIAS_TIME, Corrector, ExportFormat, ExportSource, Files, Noise
from calstation.physics import AXES, FloatArray

_SENSORS = {"gyro": "angular_velocity", "accel": "linear_acceleration"}


def _write(source: ExportSource) -> Files:
    sensor = ElementTree.Element("sensor", name=source.serial, type="imu")
    ElementTree.SubElement(sensor, "always_on").text = "1"
    ElementTree.SubElement(sensor, "update_rate").text = repr(source.imu.sample_rate_hz)
    imu = ElementTree.SubElement(sensor, "imu")
    for name, noise in (("gyro", source.gyro_noise), ("accel", source.accel_noise)):
        axes = ElementTree.SubElement(imu, _SENSORS[name])
        for axis, bias in zip(AXES, source.vector(f"{name}_bias"), strict=True):
            _add_noise(ElementTree.SubElement(axes, axis), bias, noise)
    ElementTree.indent(sensor)
    return {"": ElementTree.tostring(sensor, encoding="utf-8", xml_declaration=True) + b"\n"}


def _add_noise(axis: ElementTree.Element, bias: float, noise: Noise) -> None:
    element = ElementTree.SubElement(axis, "noise", type="gaussian")
    values = {
        "mean": bias,
        "stddev": noise.sample,
        "dynamic_bias_stddev": noise.random_walk,
        "dynamic_bias_correlation_time": BIAS_TIME,
    }
    for name, value in values.items():
        ElementTree.SubElement(element, name).text = repr(value)


def _read(files: Files) -> Corrector:
    root = ElementTree.fromstring(files[""])
    means = {
        name: np.array([float(root.findtext(f"imu/{tag}/{axis}/noise/mean", "nan")) for axis in AXES])
        for name, tag in _SENSORS.items()
    }
    signed = [element for element in root.iter("bias_mean") if float(element.text or 0.0) != 0.0]

    def correct(gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
        unknown = np.nan if signed else 0.0  # a bias with a random sign cannot be subtracted
        return gyro - means["gyro"] + unknown, accel - means["accel"] + unknown

    return correct


FORMAT = ExportFormat(frozenset({"gyro_bias", "accel_bias"}), _write, _read)
