"""A raw log: its digests, its configuration, its samples in SI units, and the rests among them."""

import hashlib
import json
import zlib
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np

from .model import AT, AXES, COUNT, NAMES, UP, WIDE, normal_gravity, rotation

#: Window, s, margin at both ends, s, and shortest usable rest, s.
WINDOW, MARGIN, SHORTEST = 0.5, 0.3, 1.0
#: Correlation time of the drift of a bias, s, and its sigma per bias instability.
DRIFT_TIME, DRIFT_SIGMA = 200.0, 1.375
#: Sections of a configuration that change what is estimated.
_SECTIONS = ("model", "imu2", "temperature")
_DIGESTED = (
    ("seq", "<i8"), ("time", "<f8"), ("counts", "<f8", (6,)), ("angles", "<f8", (2,)), ("step", "<i8"),
    ("temperature", "<f8"), ("valid", "u1"),
)  # fmt: skip


class NotCoveredError(Exception):
    """The log needs something that this program does not compute."""


class UnreadableError(Exception):
    """A file cannot be read."""


class Setting(SimpleNamespace):
    """Site, table, noise and prior, from the configuration of a log; see `setting_of`."""

    def platform(self, angles):
        """Return the rotations from the platform to n at angles of the table, rad, shape (n, 2)."""
        table = rotation(angles[:, :1] * self.axes[0]) @ rotation(angles[:, 1:] * self.axes[1])
        return rotation(-self.azimuth * UP) @ table


def setting_of(meta):
    """Return what the solution needs from the configuration of a log. Raises NotCoveredError."""
    site, imu, table = meta["site"], meta["imu"], meta.get("table", {})
    for name in _SECTIONS:
        if meta.get(name):
            raise NotCoveredError(f"the section [{name}] of the configuration")
    if site.get("azimuth_deg") is None:
        raise NotCoveredError("an unknown azimuth")
    if imu.get("bandwidth_hz") or imu.get("coning_compensated"):
        raise NotCoveredError("a filter of the unit (bandwidth_hz, coning_compensated)")
    latitude, rate, increment = np.deg2rad(site["latitude_deg"]), imu["sample_rate_hz"], imu["output"] == "increment"
    gravity = site.get("gravity_mps2") or float(normal_gravity(latitude, site["height_m"]))
    gravity_sigma = site.get("gravity_sigma_mps2") or (1e-6 if site.get("gravity_mps2") else 5e-4)
    interval, noises, steps = table.get("velocity_interval_s", 0.1), [], []
    for sensor, white in (("gyro", imu["gyro_arw"]), ("accel", imu["accel_vrw"])):
        step = imu.get(f"{sensor}_quantisation")
        steps.append(imu[f"{sensor}_lsb"] if step is None else step)
        if not increment and steps[-1] > 2.5 * white * np.sqrt(rate):
            raise NotCoveredError("an output rounded more coarsely than its noise")
        noises.append(white**2 + steps[-1] ** 2 / 12.0 * (1.0 / interval if increment else 1.0 / rate))
    mean, wide, correlation = np.zeros(COUNT), WIDE.copy(), np.eye(COUNT)
    for name, prior in meta.get("prior", {}).items():
        i = NAMES.index(name)
        mean[i], wide[i] = prior.get("value", 0.0), prior.get("sigma", wide[i])
    fixed = table.get("outer_lever") == "fixed"
    if fixed:
        mean[AT["outer_lever"]] = wide[AT["outer_lever"]] = 0.0
    for one, row in meta.get("prior_correlation", {}).items():
        for other, value in row.items():
            i, j = NAMES.index(one), NAMES.index(other)
            correlation[i, j] = correlation[j, i] = value
    defaults = {"encoder": 0.05, "mount": 1.0, "azimuth": 0.5, "base_tilt": 0.2}
    sigma = {k: np.deg2rad(table.get(f"{k}_sigma_deg", d)) for k, d in defaults.items()}
    sigma["tilt"] = np.sqrt(sigma["mount"] ** 2 + sigma["base_tilt"] ** 2 + sigma["encoder"] ** 2)
    drift = np.repeat([imu.get(f"{sensor}_bias_instability", 0.0) for sensor in ("gyro", "accel")], 3)
    axes = [np.array(table.get(f"{a}_axis", d), float) for a, d in (("outer", (1, 0, 0)), ("inner", (0, 0, 1)))]
    name = table.get("orientation", "+x+z")
    x, z = (np.eye(3)[AXES.index(half[1])] * float(half[0] + "1") for half in (name[:2], name[2:]))
    # an estimated lever arm is measured from the point of the inner axis that the profile states
    offset = 1e-3 * np.array([table.get("axis_offset_mm", (0.0, 0.0)), [table.get("axis_offset_sigma_mm", 0.5)] * 2])
    return Setting(
        meta=meta,
        gravity=gravity,
        gravity_sigma=gravity_sigma / gravity,  # relative
        latitude=float(latitude),
        azimuth=float(np.deg2rad(site["azimuth_deg"])),
        axes=[a / np.linalg.norm(a) for a in axes],  # outer and inner axis on the platform at home
        orientation=np.array([x, np.cross(z, x), z]),  # from b to the platform
        sigma=sigma,  # encoder, mount, azimuth, tilt of the base, and of the unit in all, rad
        dt=1.0 / rate,
        rate_noise=noises[0],  # (rad/s)²/Hz
        force_noise=noises[1],  # (m/s²)²/Hz
        drift=DRIFT_SIGMA * drift,  # sigma of the drift of the six biases
        velocity=table.get("velocity_sigma", 1e-3) ** 2,  # variance of a mean velocity, (m/s)²
        interval=max(interval, 1.0 / rate),
        sizes=np.repeat([imu["gyro_lsb"], imu["accel_lsb"]], 3) * (rate if increment else 1.0),  # of counts, SI
        gyro_step=steps[0],  # step of a gyro output
        mean=mean,
        covariance=correlation * np.outer(wide, wide),
        # of the offsets of the axes along outer × inner and along the inner axis: means and sigmas, m, (2, 2)
        offset=offset * [1.0, float(fixed)],
    )


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
    """Read a raw log: setting, intact rows, names of stages, results, closing record, digests, number of damaged rows.

    Raises UnreadableError and NotCoveredError.
    """
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
        lines = [texts[key].decode().split("\n")[:-1] for key in ("results", "closing")]
        results, closing = ([json.loads(line) for line in each] for each in lines)
        intact = rows[_checks(rows) == rows["check"]]
        digest = hashlib.sha256(texts["meta"]).hexdigest()
        digests = {"log": _digest(intact, stages, texts["meta"]), "configuration": digest}
        setting = setting_of(json.loads(texts["meta"]))
    except (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError) as exc:  # of a damaged file
        raise UnreadableError(f"{path} cannot be read: {exc}") from exc
    more = {"closing": closing[-1] if closing else {}, "damaged": len(rows) - len(intact)}
    return SimpleNamespace(setting=setting, rows=intact, stages=stages, results=results, digests=digests, **more)


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
    optional = [name for name in ("others", "joints", "station", "chamber") if name in rows.dtype.names]
    more = [rows[name].reshape(len(rows), -1) for name in optional]
    if more:
        columns = np.hstack(more)
        digest.update(hashlib.sha256(np.where(np.isnan(columns), np.nan, columns).astype("<f8").tobytes()).digest())
    return digest.hexdigest()


def stages_of(log):
    """Return the valid samples of the stages of a log by name; `spans` are (first, last + 1) of consecutive samples."""
    rows, found = log.rows[log.rows["valid"] != 0], {}
    for number in dict.fromkeys(rows["stage"].tolist()):
        part, name = rows[rows["stage"] == number], log.stages[number]
        if name:
            cuts = [0, *(np.flatnonzero(np.diff(part["seq"]) != 1) + 1).tolist(), len(part)]
            gyro, accel = np.hsplit(part["counts"] * log.setting.sizes, 2)
            columns = {"seq": part["seq"], "gyro": gyro, "accel": accel, "angles": part["angles"]}
            found[name] = SimpleNamespace(name=name, spans=list(pairwise(cuts)), **columns)
    return found


def rests(stage, setting, prior, spans=None):
    """Return the rests (first, last + 1) of a stage: the rate agrees with the median of its quiet windows of 0.5 s.

    `prior` is the estimate before the stage, an `estimate.Joint`.
    """
    width, margin = max(round(WINDOW / setting.dt), 2), round(MARGIN / setting.dt)
    bias, bias_sigma = prior.mean[AT["gyro_bias"]], prior.sigma[AT["gyro_bias"]].max()
    white = np.sqrt(setting.meta["imu"]["gyro_arw"] ** 2 / (width * setting.dt))
    increment = setting.meta["imu"]["output"] == "increment"
    rounding = setting.gyro_step / (width * setting.dt if increment else np.sqrt(width))
    noise, found = 5.0 * (white + rounding), []
    for first, last in spans or stage.spans:
        if last - first < 2 * width:
            continue
        both = np.hstack([stage.gyro[first:last] - stage.gyro[first], stage.accel[first:last] - stage.accel[first]])
        totals = np.vstack([np.zeros(6), np.cumsum(both, axis=0)])
        rate, force = np.hsplit((totals[width:] - totals[:-width]) / width, 2)
        rate = rate + stage.gyro[first] - bias
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
    # the velocity at a sample is the sum of the forces so far; a block's mean counts a force by its later samples
    weights, later = np.zeros(count), (width - 0.5 - np.arange(width)) / width
    after = np.cumsum(slope[::-1])[::-1] - slope
    weights[: blocks * width] = (slope[:, None] * later + after[:, None]).ravel() * dt
    noise = setting.velocity * np.sum(slope**2) + setting.force_noise * np.sum(weights**2) / dt
    return weights @ stage.accel[first:last], noise + setting.drift[3] ** 2
