"""A raw log: its digests, its configuration, its samples in SI units, and the rests among them."""

import hashlib
import json
import zlib
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np

from .model import AT, AXES, COUNT, NAMES, WIDE, normal_gravity

#: Window, s, margin at both ends, s, and shortest usable rest, s.
WINDOW, MARGIN, SHORTEST = 0.5, 0.3, 1.0
#: Correlation time of the drift of a bias, s, and its sigma per bias instability.
DRIFT_TIME, DRIFT_SIGMA = 200.0, 1.375


_DIGESTED = (
    ("seq", "<i8"), ("time", "<f8"), ("counts", "<f8", (6,)), ("angles", "<f8", (2,)), ("step", "<i8"),
    ("temperature", "<f8"), ("valid", "u1"),
)  # fmt: skip


class NotCoveredError(Exception):
    """The log needs something that this program does not compute."""


class UnreadableError(Exception):
    """A file cannot be read."""


@dataclass
class Setting:
    """Site, table, noise and prior, from the configuration of a log."""

    meta: dict
    gravity: float
    gravity_sigma: float  # relative
    latitude: float
    azimuth: float
    axes: tuple  # outer and inner axis on the platform at home
    orientation: np.ndarray  # from b to the platform
    sigma: dict  # encoder, mount, azimuth, tilt of the base, rad
    dt: float
    rate_noise: float  # (rad/s)²/Hz
    force_noise: float  # (m/s²)²/Hz
    drift: np.ndarray  # sigma of the drift of the six biases
    velocity: float  # variance of a mean velocity, (m/s)²
    interval: float
    gyro_size: float  # rad/s per count
    accel_size: float  # m/s² per count
    gyro_step: float  # step of a gyro output
    mean: np.ndarray
    covariance: np.ndarray
    offset: tuple  # distance of the axes of the table and its sigma, m


def _orientation(name):
    x, z = (np.eye(3)[AXES.index(part[1])] * (1 if part[0] == "+" else -1) for part in (name[:2], name[2:]))
    return np.array([x, np.cross(z, x), z])


def setting_of(meta):
    """Return what the solution needs from the configuration of a log. Raises NotCoveredError."""
    site, imu, table = meta["site"], meta["imu"], meta.get("table", {})
    for name, section in (
        ("model", meta.get("model")),
        ("imu2", meta.get("imu2")),
        ("temperature", meta.get("temperature")),
    ):
        if section:
            raise NotCoveredError(f"the section [{name}] of the configuration")
    if site.get("azimuth_deg") is None:
        raise NotCoveredError("an unknown azimuth")
    if imu.get("bandwidth_hz") or imu.get("coning_compensated"):
        raise NotCoveredError("a filter of the unit (bandwidth_hz, coning_compensated)")
    if any(table.get("axis_offset_mm", (0, 0))[1:]) and table.get("outer_lever") == "fixed":
        raise NotCoveredError("an offset along the inner axis with a fixed lever arm")
    latitude, rate = np.deg2rad(site["latitude_deg"]), imu["sample_rate_hz"]
    gravity = site.get("gravity_mps2") or float(normal_gravity(latitude, site["height_m"]))
    sigma = site.get("gravity_sigma_mps2") or (1e-6 if site.get("gravity_mps2") else 5e-4)
    interval, increment = table.get("velocity_interval_s", 0.1), imu["output"] == "increment"
    steps = [
        imu[f"{s}_quantisation"] if imu.get(f"{s}_quantisation") is not None else imu[f"{s}_lsb"]
        for s in ("gyro", "accel")
    ]
    noises = []
    for step, white in zip(steps, (imu["gyro_arw"], imu["accel_vrw"]), strict=True):
        if not increment and step > 2.5 * white * np.sqrt(rate):
            raise NotCoveredError("an output rounded more coarsely than its noise")
        rounding = step**2 / 12.0 * (1.0 / interval if increment else 1.0 / rate)
        noises.append(white**2 + rounding)
    mean, wide = np.zeros(COUNT), WIDE.copy()
    for name, prior in meta.get("prior", {}).items():
        mean[NAMES.index(name)] = prior.get("value", 0.0)
        wide[NAMES.index(name)] = prior.get("sigma", wide[NAMES.index(name)])
    if table.get("outer_lever") == "fixed":
        mean[AT["outer_lever"]] = wide[AT["outer_lever"]] = 0.0
    correlation = np.eye(COUNT)
    for one, row in meta.get("prior_correlation", {}).items():
        for other, value in row.items():
            i, j = NAMES.index(one), NAMES.index(other)
            correlation[i, j] = correlation[j, i] = value
    defaults = {"encoder": 0.05, "mount": 1.0, "azimuth": 0.5, "base_tilt": 0.2}
    instability = [imu.get("gyro_bias_instability", 0.0)] * 3 + [imu.get("accel_bias_instability", 0.0)] * 3
    axes = [np.array(table.get(f"{a}_axis", d), float) for a, d in (("outer", (1, 0, 0)), ("inner", (0, 0, 1)))]
    factor = rate if increment else 1.0
    return Setting(
        meta, gravity, sigma / gravity, float(latitude), float(np.deg2rad(site["azimuth_deg"])),
        tuple(a / np.linalg.norm(a) for a in axes), _orientation(table.get("orientation", "+x+z")),
        {k: np.deg2rad(table.get(f"{k}_sigma_deg", d)) for k, d in defaults.items()},
        1.0 / rate, *noises, DRIFT_SIGMA * np.array(instability),
        table.get("velocity_sigma", 1e-3) ** 2, max(interval, 1.0 / rate),
        imu["gyro_lsb"] * factor, imu["accel_lsb"] * factor, steps[0],
        mean, correlation * np.outer(wide, wide),
        (1e-3 * table.get("axis_offset_mm", (0.0, 0.0))[0], 1e-3 * table.get("axis_offset_sigma_mm", 0.5)),
    )  # fmt: skip


@dataclass
class Log:
    """A raw log."""

    setting: Setting
    rows: np.ndarray
    stages: list
    results: list
    closing: dict
    digests: dict  # of the log and of its configuration
    damaged: int  # rows with a wrong checksum


def _checks(rows):
    """Return the checksums of rows: multiply every 8 bytes by a number, add, and keep the upper half."""
    total, seed, mask, number = np.full(len(rows), 0x9E3779B97F4A7C15, np.uint64), 0x9E3779B97F4A7C15, 2**64 - 1, 0
    for name in rows.dtype.names[:-1]:
        values = np.ascontiguousarray(rows[name])
        bits = values.view(np.uint64) if values.dtype.itemsize == 8 else values.astype(np.uint64)
        for column in bits.reshape(len(rows), -1).T:
            number += 1
            z = (number * seed) & mask
            z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
            z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
            total += column * np.uint64((z ^ (z >> 31)) | 1)
    return (total >> np.uint64(32)).astype(np.uint32)


def _stored(file, name, kind, size):
    """Return a column of bytes, texts or rows. Raises ValueError unless it is stored in the file of `size` bytes."""
    data = file.get(name) if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
    if not isinstance(data, h5py.Dataset) or data.ndim != 1 or data.dtype.kind != kind or data.external:
        raise ValueError(f"{name} is not a column of the expected kind")
    if data.is_virtual or data.dtype.hasobject or data.size * data.dtype.itemsize > size:
        raise ValueError(f"{name} is larger than the file")
    return data[:]


def read_log(path):
    """Read a raw log. Raises UnreadableError and NotCoveredError."""
    try:
        size = Path(path).stat().st_size
        with h5py.File(path, "r", locking=False) as file:
            kind = file.attrs.get_id("format").dtype.kind if "format" in file.attrs else ""
            if kind != "S" or file.attrs["format"] != b"calstation.log/1":
                raise UnreadableError(f"{path} is not a raw log of format calstation.log/1")
            texts = {key: _stored(file, key, "u", size).tobytes() for key in ("meta", "results", "closing")}
            checksum, rows = int(file.attrs["meta_crc32"]), _stored(file, "samples", "V", size)
            stages = [name.decode() for name in _stored(file, "stages", "S", size)]
        if zlib.crc32(texts["meta"]) != checksum:
            raise UnreadableError(f"the configuration of {path} is damaged: its checksum is wrong")
        meta = json.loads(texts["meta"])
        lines = {key: texts[key].decode().split("\n")[:-1] for key in ("results", "closing")}
        results, closing = ([json.loads(line) for line in lines[key]] for key in ("results", "closing"))
        wrong = _checks(rows) != rows["check"]
        intact = rows[~wrong]
        digest = hashlib.sha256(texts["meta"]).hexdigest()
        digests = {"log": _digest(intact, stages, texts["meta"]), "configuration": digest}
        setting = setting_of(meta)
    except (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError) as exc:  # of a damaged file
        raise UnreadableError(f"{path} cannot be read: {exc}") from exc
    return Log(setting, intact, stages, results, closing[-1] if closing else {}, digests, int(wrong.sum()))


@dataclass
class Stage:
    """Valid samples of a stage."""

    name: str
    seq: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    angles: np.ndarray
    spans: list  # (first, last + 1) of consecutive samples


def stages_of(log):
    """Return the stages of a log in their order."""
    rows, setting, found = log.rows[log.rows["valid"] != 0], log.setting, []
    for number in dict.fromkeys(rows["stage"].tolist()):
        if not log.stages[number]:
            continue
        part = rows[rows["stage"] == number]
        cuts = [0, *(np.flatnonzero(np.diff(part["seq"]) != 1) + 1).tolist(), len(part)]
        gyro, accel = part["counts"][:, :3] * setting.gyro_size, part["counts"][:, 3:] * setting.accel_size
        spans = list(pairwise(cuts))
        found.append(Stage(log.stages[number], part["seq"], gyro, accel, part["angles"], spans))
    return found


def rests(stage, setting, bias, bias_sigma, spans=None):
    """Return the rests (first, last + 1) of a stage: the rate agrees with the median of its quiet windows of 0.5 s."""
    width, margin = max(round(WINDOW / setting.dt), 2), round(MARGIN / setting.dt)
    white = np.sqrt(setting.meta["imu"]["gyro_arw"] ** 2 / (width * setting.dt))
    increment = setting.meta["imu"]["output"] == "increment"
    rounding = setting.gyro_step / (width * setting.dt if increment else np.sqrt(width))
    noise, found = 5.0 * (white + rounding), []
    for first, last in spans or stage.spans:
        if last - first < 2 * width:
            continue
        totals = [
            np.vstack([np.zeros(3), np.cumsum(x[first:last] - x[first], axis=0)]) for x in (stage.gyro, stage.accel)
        ]
        rate = (totals[0][width:] - totals[0][:-width]) / width + stage.gyro[first] - bias
        force = (totals[1][width:] - totals[1][:-width]) / width
        change = np.abs(rate[width:] - rate[:-width]).max(axis=1)
        largest = np.abs(rate[width:]).max(axis=1)
        quiet = (change < noise + np.deg2rad(0.01)) & (largest < 3.0 * bias_sigma + noise + np.deg2rad(0.1))
        if not quiet.any():
            continue
        still = np.abs(rate - np.median(rate[width:][quiet], axis=0)).max(axis=1) < noise + np.deg2rad(0.03)
        jump = np.flatnonzero(np.abs(force[width:] - force[:-width]).max(axis=1) > 0.5)
        still[jump] = still[jump + width] = False
        edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
        for a, b in edges.reshape(-1, 2).tolist():
            begin, end = first + a + (margin if a > 0 else 0), first + b + width - 1
            end -= margin if end < last else 0
            if end - begin >= width:
                found.append((begin, end))
    return found


def mean_angles(stage, first, last):
    """Return the mean angles of outer and inner axis, rad, during a rest; None without angles."""
    polled = stage.angles[first:last]
    polled = polled[np.isfinite(polled).all(axis=1)]
    return polled.mean(axis=0) if len(polled) else None


def _digest(rows, stages, configuration):
    """Return the SHA-256 of samples and configuration: rows, then changes of stage, configuration, further columns."""
    plain = np.empty(len(rows), [*_DIGESTED])
    for name, *_ in _DIGESTED:
        values = rows[name]
        plain[name] = np.where(np.isnan(values), np.nan, values) if values.dtype.kind == "f" else values
    plain["counts"] = rows["counts"]
    starts = np.flatnonzero(np.diff(rows["stage"].astype(int), prepend=-1))
    changes = "".join(f"{k}:{stages[rows['stage'][k]]}\n" for k in starts.tolist())
    digest = hashlib.sha256()
    for part in (plain.tobytes(), changes.encode()):
        digest.update(hashlib.sha256(part).digest())
    digest.update(configuration)
    more = [rows[name].reshape(len(rows), -1) for name in ("others", "joints", "station") if name in rows.dtype.names]
    if more:
        columns = np.hstack(more)
        digest.update(hashlib.sha256(np.where(np.isnan(columns), np.nan, columns).astype("<f8").tobytes()).digest())
    return digest.hexdigest()
