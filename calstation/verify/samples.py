"""A raw log: its digests, its configuration, its samples in SI units, and the error model.

gyro   measured = (I + M_g) ω + b_g                 M_g full 3×3
accel  measured = (I + M_a) f + K2 ∘ f² + b_a       M_a lower triangular
"""

import hashlib
import json
import zlib
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
from scipy.spatial.transform import Rotation

AXES = "xyz"
#: Groups of parameters: names of their members, and the sigma, SI, if nothing is known. The last three, which are never
#: stated, are offsets of the table's axes, m (outer × inner, inner), and the relative gravity error.
GROUPS = {
    "gyro_bias": (AXES, 1e-2), "gyro_scale": (AXES, 0.05), "accel_bias": (AXES, 2.0), "accel_scale": (AXES, 0.1),
    "gyro_misalign": (("xy", "xz", "yx", "yz", "zx", "zy"), 0.05), "accel_misalign": (("yx", "zx", "zy"), 0.05),
    "accel_quadratic": (AXES, 2e-5), "inner_lever": (AXES, 0.1), "outer_lever": (AXES, 0.5),
    "axis_offset": (("hinge", "inner"), 0.0), "gravity": (("error",), 0.0),
}  # fmt: skip
PARAMETERS = [(f"{group}_{m}", group, sigma) for group, (members, sigma) in GROUPS.items() for m in members]
NAMES, GROUP, WIDE = zip(*PARAMETERS, strict=True)
COUNT = len(NAMES)
AT = {group: [i for i in range(COUNT) if GROUP[i] == group] for group in GROUPS}
BIASES, UP = AT["gyro_bias"] + AT["accel_bias"], np.array([0.0, 0.0, 1.0])
#: Exceptions of a damaged file.
DAMAGED: tuple[type[Exception], ...] = (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError)
DAMAGED += (RuntimeError, StopIteration, SyntaxError, zlib.error)
#: Columns of the samples that the digest of every log covers, and those that it covers if a log has them.
DIGESTED = {"seq": "<i8", "time": "<f8", "counts": "<f8", "angles": "<f8", "step": "<i8"}
DIGESTED, FURTHER = DIGESTED | {"temperature": "<f8", "valid": "u1"}, ("others", "joints", "station", "chamber")


class NotCoveredError(Exception):
    """The log needs something that this program does not compute."""


class UnreadableError(Exception):
    """A file cannot be read."""


def matrix(p, sensor):
    """Return I + M of the gyros or the accelerometers for parameters of shape (..., 33), shape (..., 3, 3)."""
    M = np.zeros((*p.shape[:-1], 3, 3)) + np.eye(3)
    for i in AT[sensor + "_scale"] + AT[sensor + "_misalign"]:
        row, column = (2 * NAMES[i].rpartition("_")[2])[:2]  # xx for a scale factor of x
        M[..., AXES.index(row), AXES.index(column)] += p[..., i]
    return M


def sensed(p, sensor, v):
    """Return the outputs (I + M_g) v + b_g or (I + M_a) v + K2 ∘ v² + b_a, shape (..., 3)."""
    square = p[..., AT["accel_quadratic"]] * v**2 if sensor == "accel" else 0.0
    return np.matvec(matrix(p, sensor), v) + square + p[..., AT[sensor + "_bias"]]


def compensated(p, gyro, accel):
    """Return rate, rad/s, and force at the reference point (size effect), m/s², by Newton's method, (..., 3) each."""
    omega = np.matvec(np.linalg.inv(matrix(p, "gyro")), gyro - p[..., AT["gyro_bias"]])
    inverse, force = np.linalg.inv(matrix(p, "accel")), accel
    for _ in range(4):
        force = force - np.matvec(inverse, sensed(p, "accel", force) - accel)
    return omega, force + p[..., AT["inner_lever"]] * (np.sum(omega**2, axis=-1, keepdims=True) - omega**2)


def rotation(v):
    """Return the rotation matrices of rotation vectors, rad, shape (..., 3, 3)."""
    return Rotation.from_rotvec(v).as_matrix()


def setting_of(meta):
    """Return site, table, noise and prior from the configuration of a log. Raises NotCoveredError."""
    site, imu, s = meta["site"], meta["imu"], SimpleNamespace(meta=meta)
    table = {"orientation": "+x+z", "axis_offset_mm": (0.0, 0.0), "axis_offset_sigma_mm": 0.5} | meta["table"]
    rate, interval, increment = imu["sample_rate_hz"], table["velocity_interval_s"], imu["output"] == "increment"
    white, sizes = np.array([[imu["gyro_arw"], imu["accel_vrw"]], [imu["gyro_lsb"], imu["accel_lsb"]]])
    step = np.array([imu.get("gyro_quantisation", sizes[0]), imu.get("accel_quantisation", sizes[1])])
    refused = {
        "effects, temperatures or a second IMU": any(meta.get(key) for key in ("model", "imu2")),
        "an unknown azimuth": "azimuth_deg" not in site,
        "a filter of the unit": imu.get("bandwidth_hz") or imu.get("coning_compensated"),
        "an output rounded more coarsely than its noise": not increment and np.any(step > 2.5 * white * np.sqrt(rate)),
    }
    for reason in (reason for reason, is_refused in refused.items() if is_refused):
        raise NotCoveredError(reason)
    latitude, s.azimuth = np.deg2rad(site["latitude_deg"]), np.deg2rad(site["azimuth_deg"])
    s.earth = 7.292115e-5 * np.array([0.0, np.cos(latitude), np.sin(latitude)])  # rotation in east, north, up, rad/s
    # Somigliana's normal gravity of WGS-84: flattening, ratio of the centrifugal force, height relative to the earth's
    f, m, square, height = 1.0 / 298.257223563, 0.00344978650684, np.sin(latitude) ** 2, site["height_m"] / 6378137.0
    normal = 9.7803253359 * (1.0 + 0.00193185265241 * square) / np.sqrt(1.0 - 0.00669437999014 * square)
    normal *= 1.0 - 2.0 * (1.0 + f + m - 2.0 * f * square) * height + 3.0 * height**2
    s.gravity = site.get("gravity_mps2") or normal
    s.gravity_sigma = site.get("gravity_sigma_mps2") or (1e-6 if site.get("gravity_mps2") else 5e-4)
    # outer and inner axis on the platform at home, rotation from it to n at angles (n, 2), and rotation from b to it
    s.axes = u, w = [np.array(table[key]) / np.linalg.norm(table[key]) for key in ("outer_axis", "inner_axis")]
    home, both = rotation(-s.azimuth * UP), (table["orientation"][:2], table["orientation"][2:])
    s.platform = lambda angles: home @ rotation(angles[:, :1] * u) @ rotation(angles[:, 1:] * w)
    x, z = (np.eye(3)[AXES.index(axis)] * float(sign + "1") for sign, axis in both)
    s.orientation = np.array([x, np.cross(z, x), z])
    s.sigma = {key: np.deg2rad(table[f"{key}_sigma_deg"]) for key in ("encoder", "mount", "azimuth", "base_tilt")}
    s.sigma["tilt"] = np.linalg.norm([s.sigma[key] for key in ("mount", "base_tilt", "encoder")])
    # sample period, sizes of counts; densities of white noise, SI²/Hz; noise of the mean rate of w samples
    s.dt, s.sizes = 1.0 / rate, np.repeat(sizes, 3) * (rate if increment else 1.0)
    s.rate_noise, s.force_noise = white**2 + step**2 / 12.0 * (1.0 / interval if increment else 1.0 / rate)
    s.drift = 1.375 * np.repeat([imu.get(f"{k}_bias_instability", 0.0) for k in ("gyro", "accel")], 3)
    s.interval, s.velocity = max(interval, 1.0 / rate), table["velocity_sigma"] ** 2  # variance of a mean velocity
    s.window = lambda w: white[0] * np.sqrt(rate / w) + step[0] * (rate / w if increment else 1.0 / np.sqrt(w))
    wide, correlation, s.mean = np.array(WIDE), np.eye(COUNT), np.zeros(COUNT)
    for name, prior in meta.get("prior", {}).items():
        i = NAMES.index(name)
        s.mean[i], wide[i] = prior.get("value", 0.0), prior.get("sigma", wide[i])
    if is_fixed := table["outer_lever"] == "fixed":
        s.mean[AT["outer_lever"]] = wide[AT["outer_lever"]] = 0.0
    # an estimated lever arm is measured from the point of the inner axis that the profile states
    s.offset = 1e-3 * np.array(table["axis_offset_mm"]) * [1.0, is_fixed]
    s.offset_sigma = 1e-3 * table["axis_offset_sigma_mm"] * np.array([1.0, is_fixed])
    for one, row in meta.get("prior_correlation", {}).items():
        for other, value in row.items():
            i, j = NAMES.index(one), NAMES.index(other)
            correlation[i, j] = correlation[j, i] = value
    s.covariance = correlation * np.outer(wide, wide)
    return s


def _stored(file, name, kind, size):
    """Return a column of bytes, texts or rows. Raises ValueError unless it is stored in the file of `size` bytes."""
    data = file.get(name) if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
    is_column = isinstance(data, h5py.Dataset) and data.ndim == 1 and data.dtype.kind == kind
    if not is_column or data.dtype.hasobject or data.external or data.is_virtual or data.nbytes > size:
        raise ValueError(f"{name} is not a column of the expected kind in the file")
    return data[:]


def read_log(path):
    """Read a raw log: setting, rows, stages, results, digests. Raises UnreadableError and NotCoveredError."""
    try:
        with h5py.File(path, "r", locking=False) as file:
            size, kind = Path(path).stat().st_size, file.attrs.get("format")
            if not isinstance(kind, bytes) or kind != b"calstation.log/1":
                raise UnreadableError(f"{path} is not a raw log of format calstation.log/1")
            meta, *texts = (_stored(file, key, "u", size).tobytes() for key in ("meta", "results", "closing"))
            checksum, rows = int(file.attrs["meta_crc32"]), _stored(file, "samples", "V", size)
            stages = [name.decode() for name in _stored(file, "stages", "S", size)]
        if zlib.crc32(meta) != checksum:
            raise UnreadableError(f"the configuration of {path} is damaged: its checksum is wrong")
        results, closing = ([json.loads(line) for line in text.decode().split("\n")[:-1]] for text in texts)
        digests = {"log": _digest(rows, stages, meta), "configuration": hashlib.sha256(meta).hexdigest()}
        closed, setting = closing[-1].get("sha256") if closing else None, setting_of(json.loads(meta))
    except DAMAGED as exc:
        raise UnreadableError(f"{path} cannot be read: {exc}") from exc
    return SimpleNamespace(setting=setting, rows=rows, stages=stages, results=results, closed=closed, digests=digests)


def _digest(rows, stages, configuration):
    """Return the SHA-256 of samples and configuration: rows, then changes of stage, configuration, further columns."""
    plain = np.empty(len(rows), [(name, kind, rows[name].shape[1:]) for name, kind in DIGESTED.items()])
    for name, kind in DIGESTED.items():
        plain[name] = np.where(np.isnan(rows[name]), np.nan, rows[name]) if "f" in kind else rows[name]
    starts = np.flatnonzero(np.diff(rows["stage"].astype(int), prepend=-1))
    changes = "".join(f"{k}:{stages[rows['stage'][k]]}\n" for k in starts.tolist())
    parts = [hashlib.sha256(part).digest() for part in (plain.tobytes(), changes.encode())] + [configuration]
    if further := [rows[name].reshape(len(rows), -1) for name in FURTHER if name in rows.dtype.names]:
        columns = np.hstack(further)
        parts.append(hashlib.sha256(np.where(np.isnan(columns), np.nan, columns).astype("<f8").tobytes()).digest())
    return hashlib.sha256(b"".join(parts)).hexdigest()


def stages_of(log, first, last):
    """Return the valid samples from `first` to `last` by stage; `spans` are (start, stop) of consecutive ones."""
    rows, found = log.rows[(log.rows["valid"] != 0) & (log.rows["seq"] >= first) & (log.rows["seq"] <= last)], {}
    for number in dict.fromkeys(rows["stage"].tolist()):
        part, name = rows[rows["stage"] == number], log.stages[number]
        if not np.isfinite(part["angles"]).any():
            raise NotCoveredError(f"the stage {name} without angles of the table")
        cuts = [0, *(np.flatnonzero(np.diff(part["seq"]) != 1) + 1).tolist(), len(part)]
        columns = {key: part[key] for key in ("seq", "angles", "temperature")}
        columns["gyro"], columns["accel"] = np.hsplit(part["counts"] * log.setting.sizes, 2)
        found[name] = SimpleNamespace(name=name, spans=list(pairwise(cuts)), **columns)
    return found
