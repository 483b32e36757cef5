"""A raw log: its digests, its configuration, its samples in SI units, and the rests among them."""

import hashlib
import json
import zlib
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np

from .model import AT, AXES, COUNT, EARTH_RATE, NAMES, UP, WIDE, normal_gravity, rotation

#: Window, s, margin at both ends, s, and shortest usable rest, s.
WINDOW, MARGIN, SHORTEST = 0.5, 0.3, 1.0
#: Correlation time of the drift of a bias, s, and its sigma per bias instability.
DRIFT_TIME, DRIFT_SIGMA = 200.0, 1.375
#: Entries of a table profile that it may omit.
TABLE: dict[str, object] = {
    "outer_axis": (1.0, 0.0, 0.0),
    "inner_axis": (0.0, 0.0, 1.0),
    "orientation": "+x+z",
    "outer_lever": "",
}
TABLE |= {"encoder_sigma_deg": 0.05, "mount_sigma_deg": 1.0, "azimuth_sigma_deg": 0.5, "base_tilt_sigma_deg": 0.2}
TABLE |= {"velocity_sigma": 1e-3, "velocity_interval_s": 0.1, "axis_offset_mm": (0.0, 0.0), "axis_offset_sigma_mm": 0.5}
#: Columns of the samples that the digest of every log covers, and those that it covers if a log has them.
DIGESTED = {"seq": "<i8", "time": "<f8", "counts": "<f8", "angles": "<f8", "step": "<i8"}
DIGESTED |= {"temperature": "<f8", "valid": "u1"}
FURTHER = ("others", "joints", "station", "chamber")


class NotCoveredError(Exception):
    """The log needs something that this program does not compute."""


class UnreadableError(Exception):
    """A file cannot be read."""


def setting_of(meta):
    """Return site, table, noise and prior from the configuration of a log. Raises NotCoveredError."""
    site, imu, table, s = meta["site"], meta["imu"], TABLE | meta.get("table", {}), SimpleNamespace(meta=meta)
    rate, increment, interval = imu["sample_rate_hz"], imu["output"] == "increment", table["velocity_interval_s"]
    white, sizes = np.array([imu["gyro_arw"], imu["accel_vrw"]]), np.array([imu["gyro_lsb"], imu["accel_lsb"]])
    given = [imu.get("gyro_quantisation"), imu.get("accel_quantisation")]
    step = np.where([x is None for x in given], sizes, np.array(given, float))
    for name in ("model", "imu2", "temperature"):
        if meta.get(name):
            raise NotCoveredError(f"the section [{name}] of the configuration")
    if site.get("azimuth_deg") is None:
        raise NotCoveredError("an unknown azimuth")
    if imu.get("bandwidth_hz") or imu.get("coning_compensated"):
        raise NotCoveredError("a filter of the unit (bandwidth_hz, coning_compensated)")
    if not increment and np.any(step > 2.5 * white * np.sqrt(rate)):
        raise NotCoveredError("an output rounded more coarsely than its noise")
    latitude, s.azimuth = np.deg2rad(site["latitude_deg"]), np.deg2rad(site["azimuth_deg"])
    s.earth = EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])  # rotation in east, north, up, rad/s
    s.gravity = site.get("gravity_mps2") or normal_gravity(latitude, site["height_m"])
    s.gravity_sigma = site.get("gravity_sigma_mps2") or (1e-6 if site.get("gravity_mps2") else 5e-4)
    # outer and inner axis on the platform at home, rotation from it to n at angles (n, 2), and rotation from b to it
    s.axes = [np.array(table[key], float) / np.linalg.norm(table[key]) for key in ("outer_axis", "inner_axis")]
    home, (u, w) = rotation(-s.azimuth * UP), s.axes
    s.platform = lambda angles: home @ rotation(angles[:, :1] * u) @ rotation(angles[:, 1:] * w)
    halves = table["orientation"][:2], table["orientation"][2:]
    x, z = (np.eye(3)[AXES.index(half[1])] * float(half[0] + "1") for half in halves)
    s.orientation = np.array([x, np.cross(z, x), z])
    s.sigma = {key: np.deg2rad(table[f"{key}_sigma_deg"]) for key in ("encoder", "mount", "azimuth", "base_tilt")}
    s.sigma["tilt"] = np.linalg.norm([s.sigma[key] for key in ("mount", "base_tilt", "encoder")])
    # sample period, sizes of counts, SI; densities of white noise with rounding, (rad/s)²/Hz and (m/s²)²/Hz
    s.dt, s.sizes = 1.0 / rate, np.repeat(sizes, 3) * (rate if increment else 1.0)
    s.rate_noise, s.force_noise = white**2 + step**2 / 12.0 * (1.0 / interval if increment else 1.0 / rate)
    s.drift = DRIFT_SIGMA * np.repeat([imu.get(f"{k}_bias_instability", 0.0) for k in ("gyro", "accel")], 3)
    s.interval, s.velocity = max(interval, 1.0 / rate), table["velocity_sigma"] ** 2  # variance of a mean velocity
    # noise of the mean rate of a window of w samples
    s.window = lambda w: white[0] * np.sqrt(rate / w) + step[0] * (rate / w if increment else 1.0 / np.sqrt(w))
    wide, correlation, s.mean = WIDE.copy(), np.eye(COUNT), np.zeros(COUNT)
    for name, prior in meta.get("prior", {}).items():
        i = NAMES.index(name)
        s.mean[i], wide[i] = prior.get("value", 0.0), prior.get("sigma", wide[i])
    fixed = table["outer_lever"] == "fixed"
    if fixed:
        s.mean[AT["outer_lever"]] = wide[AT["outer_lever"]] = 0.0
    for one, row in meta.get("prior_correlation", {}).items():
        for other, value in row.items():
            i, j = NAMES.index(one), NAMES.index(other)
            correlation[i, j] = correlation[j, i] = value
    s.covariance = correlation * np.outer(wide, wide)
    # an estimated lever arm is measured from the point of the inner axis that the profile states
    s.offset = 1e-3 * np.array(table["axis_offset_mm"]) * [1.0, fixed]
    s.offset_sigma = 1e-3 * table["axis_offset_sigma_mm"] * np.array([1.0, fixed])
    return s


def _stored(file, name, kind, size):
    """Return a column of bytes, texts or rows. Raises ValueError unless it is stored in the file of `size` bytes."""
    data = file.get(name) if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
    if not isinstance(data, h5py.Dataset) or data.ndim != 1 or data.dtype.kind != kind or data.external:
        raise ValueError(f"{name} is not a column of the expected kind")
    if data.is_virtual or data.dtype.hasobject or data.size * data.dtype.itemsize > size:
        raise ValueError(f"{name} is larger than the file")
    return data[:]


def read_log(path):
    """Read a raw log: setting, rows, names of stages, results, closing record, digests.

    Raises UnreadableError and NotCoveredError.
    """
    try:
        with h5py.File(path, "r", locking=False) as file:
            size, kind = (
                Path(path).stat().st_size,
                file.attrs.get_id("format").dtype.kind if "format" in file.attrs else "",
            )
            if kind != "S" or file.attrs["format"] != b"calstation.log/1":
                raise UnreadableError(f"{path} is not a raw log of format calstation.log/1")
            meta, *texts = (_stored(file, key, "u", size).tobytes() for key in ("meta", "results", "closing"))
            checksum, rows = int(file.attrs["meta_crc32"]), _stored(file, "samples", "V", size)
            stages = [name.decode() for name in _stored(file, "stages", "S", size)]
        if zlib.crc32(meta) != checksum:
            raise UnreadableError(f"the configuration of {path} is damaged: its checksum is wrong")
        results, closing = ([json.loads(line) for line in text.decode().split("\n")[:-1]] for text in texts)
        digests = {"log": _digest(rows, stages, meta), "configuration": hashlib.sha256(meta).hexdigest()}
        setting = setting_of(json.loads(meta))
    except (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError) as exc:  # of a damaged file
        raise UnreadableError(f"{path} cannot be read: {exc}") from exc
    closed = closing[-1].get("sha256") if closing else None
    return SimpleNamespace(setting=setting, rows=rows, stages=stages, results=results, closed=closed, digests=digests)


def _digest(rows, stages, configuration):
    """Return the SHA-256 of samples and configuration: rows, then changes of stage, configuration, further columns."""
    plain = np.empty(len(rows), [(name, kind, rows[name].shape[1:]) for name, kind in DIGESTED.items()])
    for name, kind in DIGESTED.items():
        plain[name] = np.where(np.isnan(rows[name]), np.nan, rows[name]) if "f" in kind else rows[name]
    starts = np.flatnonzero(np.diff(rows["stage"].astype(int), prepend=-1))
    changes = "".join(f"{k}:{stages[rows['stage'][k]]}\n" for k in starts.tolist())
    parts = [hashlib.sha256(part).digest() for part in (plain.tobytes(), changes.encode())] + [configuration]
    further = [rows[name].reshape(len(rows), -1) for name in FURTHER if name in rows.dtype.names]
    if further:
        columns = np.hstack(further)
        parts.append(hashlib.sha256(np.where(np.isnan(columns), np.nan, columns).astype("<f8").tobytes()).digest())
    return hashlib.sha256(b"".join(parts)).hexdigest()


def stages_of(log, first, last):
    """Return the valid samples from `first` to `last` by stage; `spans` are (start, stop) of consecutive ones."""
    rows, found = log.rows[(log.rows["valid"] != 0) & (log.rows["seq"] >= first) & (log.rows["seq"] <= last)], {}
    for number in dict.fromkeys(rows["stage"].tolist()):
        part, name = rows[rows["stage"] == number], log.stages[number]
        cuts = [0, *(np.flatnonzero(np.diff(part["seq"]) != 1) + 1).tolist(), len(part)]
        gyro, accel = np.hsplit(part["counts"] * log.setting.sizes, 2)
        columns = {"seq": part["seq"], "gyro": gyro, "accel": accel, "angles": part["angles"]}
        found[name] = SimpleNamespace(name=name, spans=list(pairwise(cuts)), **columns)
    return found


def rests(stage, s, prior, spans=None):
    """Return the rests (first, last + 1) of a stage: the rate agrees with the median of its quiet windows of 0.5 s.

    `prior` is the estimate before the stage, an `estimate.Joint`.
    """
    width, margin, found = max(round(WINDOW / s.dt), 2), round(MARGIN / s.dt), []
    bias, bias_sigma = prior.mean[AT["gyro_bias"]], prior.sigma[AT["gyro_bias"]].max()
    noise = 5.0 * s.window(width)
    for first, last in spans or stage.spans:
        if last - first < 2 * width:
            continue
        outputs = np.hstack([stage.gyro[first:last], stage.accel[first:last]])
        totals = np.cumsum(np.vstack([np.zeros(6), outputs - outputs[0]]), axis=0)
        means = (totals[width:] - totals[:-width]) / width + outputs[0]
        rate, change = means[:, :3] - bias, np.abs(means[width:] - means[:-width])
        quiet = np.abs(rate[width:]).max(axis=1) < 3.0 * bias_sigma + noise + np.deg2rad(0.1)
        quiet &= change[:, :3].max(axis=1) < noise + np.deg2rad(0.01)
        if not quiet.any():
            continue
        still = np.abs(rate - np.median(rate[width:][quiet], axis=0)).max(axis=1) < noise + np.deg2rad(0.03)
        jump = np.flatnonzero(change[:, 3:].max(axis=1) > 0.5)
        still[jump] = still[jump + width] = False
        edges = np.flatnonzero(np.diff(still.astype(int), prepend=0, append=0))
        for a, b in edges.reshape(-1, 2).tolist():
            begin, end = first + a + margin * (a > 0), first + b + width - 1
            end -= margin * (end < last)
            if end - begin >= width:
                found.append((begin, end))
    return found


def mean_angles(stage, rest):
    """Return the mean angles of outer and inner axis, rad, during a rest. Raises NotCoveredError without angles."""
    polled = stage.angles[slice(*rest)]
    polled = polled[np.isfinite(polled).all(axis=1)]
    if not len(polled):
        raise NotCoveredError(f"the stage {stage.name} without angles of the table")
    return polled.mean(axis=0)


def mean_force(stage, setting, first, last):
    """Return the force of a rest, m/s², as the slope of a line through its mean velocities, and its variance."""
    dt, count = setting.dt, last - first
    stride = max(round(setting.interval / dt), 1)
    width, blocks = min(stride, max(count // 2, 1)), max(count // stride, 2)
    middle = np.arange(blocks) - 0.5 * (blocks - 1)
    slope = middle / (np.sum(middle**2) * width * dt)  # of a line through the mean velocities
    # a block's mean is that of the velocities at the starts of its samples, which count a force by the later ones
    weights, later = np.zeros(count), (width - 1.0 - np.arange(width)) / width
    after = np.cumsum(slope[::-1])[::-1] - slope
    weights[: blocks * width] = (slope[:, None] * later + after[:, None]).ravel() * dt
    noise = setting.velocity * np.sum(slope**2) + setting.force_noise * np.sum(weights**2) / dt
    return weights @ stage.accel[first:last], noise + setting.drift[3] ** 2
