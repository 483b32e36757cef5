"""A second simulator of a table and a unit in plain NumPy, independent of the virtual bench and the solvers.

Angles of the joints are closed forms with smooth ramps; attitude, rate and force follow from them at the ends and
middles of the samples, and Simpson's rule integrates the output. All values are in SI, except effects, which
have the units of their names. Bearings are perfect and bias instability is left out.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.signal import lfilter

Array = np.ndarray

G = 9.80665
DPH = np.pi / 180.0 / 3600.0
UG = 1e-6 * G
EARTH = 7.292115e-5
#: Rest after a move before the next step, interval of the encoder readings, and correlation time of the vibration, s.
#: Means of the vibration over 0.1 s have the rms `velocity_sigma`, its samples RMS times as much.
SETTLE, POLL, VIBRATION = 0.3, 0.05, 0.01
RMS = (2.0 * VIBRATION / 0.1 * (1.0 - VIBRATION / 0.1)) ** -0.5
READING_SIGMA = np.deg2rad(0.0005)
CHUNK = 20_000
AXES = "xyz"
OFF_DIAGONAL = ("accel_cross_ug_g2", "accel_off_axis_mm")
MATRICES = (*OFF_DIAGONAL, "g_sensitivity_dph_g", "accel_rate_square_ug", "gyro_flex_urad_g", "gyro_g_square_dph_g2")
FAST = np.deg2rad(100.0)
PAIRS = [(i, j) for i in range(3) for j in range(3) if i != j]


@dataclass(frozen=True)
class Site:
    """Gravity and the table; `base_tilt` and `mount` are rotation vectors, axes are unit vectors in b at home."""

    latitude: float
    gravity: float
    azimuth: float = 0.0
    base_tilt: tuple[float, ...] = (0.0, 0.0, 0.0)
    mount: tuple[float, ...] = (0.0, 0.0, 0.0)
    outer_axis: tuple[float, ...] = (1.0, 0.0, 0.0)
    inner_axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    non_orthogonality: float = 0.0
    axis_offset: tuple[float, ...] = (0.0, 0.0)
    velocity_sigma: float = 0.0
    encoder_sigma: float = 0.0
    #: Further motion, by the names of `[bench.table_motion]`.
    motion: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Unit:
    """A unit: its 30 parameters by name, its output, white noise, and effects by the names of `[bench.effects]`."""

    parameters: Mapping[str, float]
    sample_rate: float
    output: str
    gyro_lsb: float
    accel_lsb: float
    gyro_arw: float = 0.0
    accel_vrw: float = 0.0
    effects: Mapping[str, Any] = field(default_factory=dict)


@dataclass
class Samples:
    """Samples of a stage as a station records them; `angles` are NaN between readings, shape (n, 2)."""

    seq: Array
    time: Array
    counts: Array
    angles: Array
    step: Array
    temperature: Array


def turn(axis: Any, angle: Any) -> Array:
    """Rotation matrices about a unit vector, by angles of shape (n,) or a number."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + s * K + (1.0 - c) * (K @ K)


def turned(vector: Any) -> Array:
    """Rotation matrix of a rotation vector."""
    size = np.float64(np.linalg.norm(vector))
    return np.eye(3) if size == 0.0 else turn(np.asarray(vector) / size, size)


class Joint:
    """The angle of a joint over time: rests, and moves with raised-cosine ramps of the rate."""

    def __init__(self) -> None:
        #: Start, start angle, angle, largest rate, duration of a ramp and of the whole move.
        self.moves = [(-1e9, 0.0, 0.0, 0.0, 1.0, 2.0)]
        #: Encoder error at the end of every move.
        self.errors = [0.0]

    @property
    def target(self) -> float:
        """Angle after the last move."""
        return self.moves[-1][1] + self.moves[-1][2]

    def move(self, start: float, target: float, rate: float, acceleration: float) -> float:
        """Add a move; return its duration."""
        angle = target - self.target
        peak = min(rate, np.sqrt(2.0 * abs(angle) * acceleration / np.pi))
        ramp = 0.5 * np.pi * peak / acceleration
        whole = abs(angle) / peak + ramp
        self.moves.append((start, self.target, angle, np.sign(angle) * peak, ramp, whole))
        return whole

    def states(self, times: Array) -> tuple[Array, Array, Array]:
        """Angle, rate and acceleration at times of shape (n,)."""
        index = np.searchsorted([move[0] for move in self.moves], times, side="right") - 1
        start, before, angle, peak, ramp, whole = np.array(self.moves)[index].T
        t = np.clip(times - start, 0.0, whole)
        rising, falling = t < ramp, t > whole - ramp
        s = np.where(rising, t, np.where(falling, whole - t, ramp))  # time from the nearer end of the move
        k = np.pi / ramp
        covered = 0.5 * peak * (s - np.sin(k * s) / k)
        q = np.where(rising, covered, np.where(falling, angle - covered, 0.5 * peak * ramp + peak * (t - ramp)))
        rate = 0.5 * peak * (1.0 - np.cos(k * s))
        acceleration = np.where(rising, 1.0, np.where(falling, -1.0, 0.0)) * 0.5 * peak * k * np.sin(k * s)
        return before + q, rate, acceleration

    def error(self, times: Array) -> Array:
        """Encoder error at times of shape (n,), which changes with the angle of a move."""
        index = np.searchsorted([move[0] for move in self.moves], times, side="right") - 1
        _, before, angle, *_ = np.array(self.moves)[index].T
        share = np.where(angle == 0.0, 1.0, (self.states(times)[0] - before) / np.where(angle == 0.0, 1.0, angle))
        errors = np.array([0.0, *self.errors])
        return errors[index] + share * (errors[index + 1] - errors[index])


class PlainBench:
    """Simulates stages in sequence; time, joints and errors continue from stage to stage."""

    def __init__(self, site: Site, unit: Unit, seed: int = 0) -> None:
        self.site, self.unit = site, unit
        self.random = np.random.default_rng([seed, 77])
        self.joints: tuple[Any, Any] = (Joint(), Joint())
        self.produced = self.steps = 0
        self.effects = dict(unit.effects)
        for name in MATRICES:
            value = np.asarray(self.effects.get(name, 0.0), dtype=float)
            if value.ndim == 0:
                value = value * self.random.choice([-1.0, 1.0], (3, 3))
                value = value * (1.0 - np.eye(3)) if name in OFF_DIAGONAL else value
            self.effects[name] = value
        self.interval = 1.0 / unit.sample_rate / (1.0 + 1e-6 * self.effect("sample_clock_ppm")[0])
        self.residue = np.zeros(6)
        self.filtered: Array | None = None  # output of the low-pass at the end of the last sample
        self.angle, self.sense = np.zeros(3), np.zeros(3)  # of the current turn about each axis, and of the last one
        self.walk = np.zeros(6)
        self.slow = np.zeros((0, 3))
        self.velocity = RMS * site.velocity_sigma * self.random.standard_normal(3)
        for joint in self.joints:
            joint.errors[0] = site.encoder_sigma * self.random.standard_normal()

    def effect(self, name: str, default: float = 0.0) -> Array:
        """Value of an effect for the three axes."""
        return np.broadcast_to(np.asarray(self.effects.get(name, default), dtype=float), 3)

    @property
    def now(self) -> float:
        """End of the last sample."""
        return self.produced * self.interval

    def vector(self, group: str) -> Array:
        """The three values of a group."""
        return np.array([self.unit.parameters.get(f"{group}_{axis}", 0.0) for axis in AXES])

    def matrix(self, sensor: str) -> Array:
        """Scale factors and misalignments of a sensor."""
        found = np.eye(3) + np.diag(self.vector(f"{sensor}_scale"))
        for i, j in PAIRS:
            found[i, j] += self.unit.parameters.get(f"{sensor}_misalign_{AXES[i]}{AXES[j]}", 0.0)
        return found

    def motion(self, times: Array) -> tuple[Array, Array, Array, Array]:
        """Attitude b to n, inertial rate, its derivative, and force at the centre, in b."""
        site = self.site
        outer, inner = (np.asarray(axis, dtype=float) for axis in (site.outer_axis, site.inner_axis))
        hinge = np.cross(outer, inner)
        tilt, tilting = self.tilt(times)
        x, y, z = np.moveaxis(tilt, 1, 0)
        small = np.eye(3) + np.moveaxis(np.array([[0 * z, -z, y], [z, 0 * z, -x], [-y, x, 0 * z]]), 2, 0)
        base = small @ turned(site.base_tilt) @ turned((0.0, 0.0, -site.azimuth))
        between = turned(site.non_orthogonality * hinge / np.linalg.norm(hinge))
        mount = turned(site.mount)
        (qo, vo, ao), (qi, vi, ai) = (joint.states(times) for joint in self.joints)
        platform = between @ turn(inner, qi)
        attitude = base @ turn(outer, qo) @ platform
        earth = EARTH * np.array([0.0, np.cos(site.latitude), np.sin(site.latitude)])
        u = np.einsum("nji,j->ni", platform, outer)  # the outer axis on the platform
        relative = u * vo[:, None] + inner * vi[:, None]
        sensed_earth = np.einsum("nji,j->ni", attitude, earth)
        rate = sensed_earth + relative + np.einsum("nji,nj->ni", attitude, tilting)
        change = -np.cross(relative, sensed_earth) + u * ao[:, None] + inner * ai[:, None]
        change -= np.cross(inner, u) * (vi * vo)[:, None]
        force = np.einsum("nji,j->ni", attitude, [0.0, 0.0, site.gravity])
        # second derivative of the position T(q_o) d of the inner bearing: T (v² K² + a K) d, on the rotating earth
        d = np.array(site.axis_offset) @ np.stack([hinge / np.linalg.norm(hinge), inner])
        tangent, inward = np.cross(outer, d), np.cross(outer, np.cross(outer, d))
        earth_on_arm = np.einsum("nji,j->ni", base @ turn(outer, qo), earth)
        moved = ao[:, None] * tangent + vo[:, None] ** 2 * inward + 2.0 * vo[:, None] * np.cross(earth_on_arm, tangent)
        force += np.einsum("nji,nj->ni", platform, moved)
        return attitude @ mount, rate @ mount, change @ mount, force @ mount

    def tilt(self, times: Array) -> tuple[Array, Array]:
        """Rotation of the base by rocking, and by creep about the east axis after each move, and its rate, in n."""
        s, angle, rate = self.site.motion, np.zeros((len(times), 3)), np.zeros((len(times), 3))
        f = 2.0 * np.pi * s.get("rocking_hz", 3.0)
        angle[:, 1] += 1e-6 * s.get("rocking_urad", 0.0) * np.sin(f * times)
        rate[:, 1] += 1e-6 * s.get("rocking_urad", 0.0) * f * np.cos(f * times)
        ends = sorted(start + whole for joint in self.joints for start, *_, whole in getattr(joint, "moves", [])[1:])
        for k, end in enumerate(ends if s.get("creep_urad") else []):
            passed, decay = np.maximum(times - end, 0.0), s.get("creep_s", 10.0)
            size = 1e-6 * s["creep_urad"] * (-1.0) ** k
            angle[:, 0] += size * (1.0 - np.exp(-passed / decay))
            rate[:, 0] += np.where(passed > 0.0, size / decay * np.exp(-passed / decay), 0.0)
        return angle, rate

    def base_velocity(self, first: int, count: int) -> Array:
        """Sway along east and up, and slow motion, at the borders of samples."""
        s, velocity = self.site.motion, np.zeros((count + 1, 3))
        times = (first + np.arange(count + 1))[:, None] * self.interval
        sway = np.sqrt(2.0) * 1e-3 * s.get("sway_mm_s", 0.0)
        velocity[:, ::2] += sway * np.cos(2.0 * np.pi * s.get("sway_hz", 8.0) * times + [0.4, 1.1])
        if s.get("slow_mm_s"):
            width = round(s.get("slow_s", 1.0) / self.interval)
            self.slow = np.vstack([self.slow, self.random.standard_normal((first + count + width - len(self.slow), 3))])
            sums = np.vstack([np.zeros((1, 3)), np.cumsum(self.slow[first:], axis=0)])
            moving = np.vstack([sums[width:] - sums[:-width]])[: count + 1]
            velocity += 1e-3 * s["slow_mm_s"] * moving / np.sqrt(width)
        return velocity

    def output(self, times: Array) -> tuple[Array, Array]:
        """Output of gyros and accelerometers at times, without noise, each of shape (n, 3)."""
        delays = 1e-3 * np.concatenate([self.effect("gyro_delay_ms"), self.effect("accel_delay_ms")])
        late = {delay: np.hstack(self.sensed(times - delay)) for delay in set(delays)}
        both = np.stack([late[delay][:, i] for i, delay in enumerate(delays)], axis=1)
        gyro, accel = both[:, :3], both[:, 3:]
        grown = 1.0 - np.exp(-times / self.effect("warm_up_s", 300.0)[0])[:, None]
        stepped = (times > self.effect("jump_at_s", 600.0)[0])[:, None]
        gyro = gyro * (1.0 + 1e-6 * grown * self.effect("warm_up_gyro_scale_ppm"))
        accel = accel * (1.0 + 1e-6 * grown * self.effect("warm_up_accel_scale_ppm"))
        gyro += DPH * (grown * self.effect("warm_up_gyro_bias_dph") + stepped * self.effect("gyro_jump_dph"))
        accel += UG * (grown * self.effect("warm_up_accel_bias_ug") + stepped * self.effect("accel_jump_ug"))
        return gyro, accel

    def sensed(self, times: Array) -> tuple[Array, Array]:
        """Output without changes over time and without delay."""
        _, w, a, centre = self.motion(times)
        lever, inner = self.vector("outer_lever"), self.vector("inner_lever")
        off_axis = 1e-3 * self.effects["accel_off_axis_mm"]
        f = centre.copy()
        for i in range(3):
            site = lever + inner * np.eye(3)[i] + off_axis[i]
            f[:, i] += (np.cross(w, np.cross(w, site)) + np.cross(a, site))[:, i]
        share = np.abs(w) / np.deg2rad(100.0)
        nonlinear = self.effect("gyro_asymmetry_ppm") * np.sign(w) + self.effect("gyro_square_ppm") * share * np.sign(w)
        gyro = w @ self.matrix("gyro").T + self.vector("gyro_bias")
        gyro += 1e-6 * w * (nonlinear + self.effect("gyro_cubic_ppm") * share**2)
        gyro += DPH / G * f @ self.effects["g_sensitivity_dph_g"].T
        in_g = f / G
        products = np.stack([in_g[:, 1] * in_g[:, 2], in_g[:, 2] * in_g[:, 0], in_g[:, 0] * in_g[:, 1]], axis=1)
        accel = f @ self.matrix("accel").T + self.vector("accel_bias") + self.vector("accel_quadratic") * f**2
        accel += UG * (self.effect("accel_cubic_ug_g3") * in_g**3 + products @ self.effects["accel_cross_ug_g2"].T)
        accel += UG * (w / FAST) ** 2 @ self.effects["accel_rate_square_ug"].T
        accel += UG * self.effect("accel_fifth_ug_g5") * in_g**5
        gyro += DPH * in_g**2 @ self.effects["gyro_g_square_dph_g2"].T
        gyro += 1e-6 * self.effect("gyro_fifth_ppm") * w * share**4
        gyro += np.cross(w, 1e-6 * in_g @ self.effects["gyro_flex_urad_g"].T)
        running = sum(np.abs(joint.states(times)[1]) for joint in self.joints)[:, None] > 1e-3
        gyro += DPH * running * self.effect("gyro_moving_bias_dph")
        accel += UG * running * self.effect("accel_moving_bias_ug")
        return gyro, accel + 1e-6 * self.effect("accel_asymmetry_ppm") * np.abs(f)

    def increments(self, first: int, count: int) -> Array:
        """Noise-free increments of samples from number `first` on, shape (count, 6)."""
        constant = 1e-3 * self.effect("low_pass_ms")[0]
        per = 2 * int(np.ceil(2.0 * self.interval / constant)) if constant else 2  # parts of a sample, in pairs
        times = (first + np.arange(per * count + 1) / per) * self.interval
        output = np.hstack(self.output(times))
        if constant:
            step = self.interval / per / constant  # in which the input is taken as linear
            keep, after = np.exp(-step), 1.0 + np.expm1(-step) / step
            start = output[0] if self.filtered is None else self.filtered
            driven = (1.0 - keep - after) * output[:-1] + after * output[1:]
            smooth, _ = lfilter([1.0], [1.0, -keep], driven, axis=0, zi=keep * start[None])
            output = np.vstack([start, smooth])
            self.filtered = output[-1]
        if any(self.effect(name).any() for name in ("gyro_hysteresis_dph", "gyro_scale_hysteresis_ppm")):
            turned = self.last_turns(times)
            output[:, :3] *= 1.0 + 1e-6 * turned * self.effect("gyro_scale_hysteresis_ppm")
            output[:, :3] += DPH * turned * self.effect("gyro_hysteresis_dph")
        coning = np.zeros((count, 3))
        if self.effect("coning_compensation").any():
            # rotation vector of a sample from the increments of its halves (Miller's two-sample algorithm)
            ends, middles = output[::per, :3], output[per // 2 :: per, :3]
            halves = [self.interval / 24.0 * (5.0 * ends[:-1] + 8.0 * middles - ends[1:])]
            halves += [self.interval / 24.0 * (5.0 * ends[1:] + 8.0 * middles - ends[:-1])]
            coning = 2.0 / 3.0 * self.effect("coning_compensation")[0] * np.cross(*halves)
        pairs = (output[:-1:2] + 4.0 * output[1::2] + output[2::2]).reshape(count, per // 2, 6)
        increments = self.interval / (3.0 * per) * pairs.sum(axis=1)
        increments[:, :3] += coning
        return increments

    def last_turns(self, times: Array) -> Array:
        """Sense of the last turn from rest to rest about each axis at times, shape (n, 3)."""
        rates = self.motion(times)[1]
        step, completed = times[1] - times[0], np.empty_like(rates)
        for k, rate in enumerate(rates):
            if (np.abs(rate) > np.deg2rad(1.0)).any():
                self.angle += rate * step
            else:
                far = np.abs(self.angle) > np.deg2rad(1.0)
                self.sense[far] = np.sign(self.angle)[far]
                self.angle[:] = 0.0
            completed[k] = self.sense
        return completed

    def produce(self, duration: float) -> tuple[Array, Array, Array]:
        """Return counts, angles and step numbers of the next samples."""
        count = int(np.ceil(duration / self.interval - 1e-9))
        parts = [self.chunk(min(CHUNK, count - done)) for done in range(0, count, CHUNK)]
        first = self.produced - count
        ends = (first + 1 + np.arange(count)) * self.interval
        angles = np.full((count, 2), np.nan)
        every = max(1, round(POLL * self.unit.sample_rate))
        polled = (first + 1 + np.arange(count)) % every == 0
        for k, joint in enumerate(self.joints):
            angles[polled, k] = joint.states(ends[polled])[0] + joint.error(ends[polled])
        angles += READING_SIGMA * self.random.standard_normal(angles.shape) * bool(self.site.encoder_sigma)
        return np.concatenate([np.empty((0, 6)), *parts]), angles, np.full(count, self.steps)

    def chunk(self, count: int) -> Array:
        """Counts of the next samples."""
        unit, h = self.unit, self.interval
        values = self.increments(self.produced, count)
        middle = (self.produced + 0.5 + np.arange(count)) * h
        keep = np.exp(-h / VIBRATION)
        kicks = RMS * self.site.velocity_sigma * np.sqrt(1.0 - keep**2) * self.random.standard_normal((count, 3))
        moved, _ = lfilter([1.0], [1.0, -keep], kicks, axis=0, zi=keep * self.velocity[None])
        velocity = np.vstack([self.velocity, moved])
        self.velocity = velocity[-1]
        velocity = velocity + self.base_velocity(self.produced, count)
        shaken = np.einsum("nji,nj->ni", self.motion(middle)[0], np.diff(velocity, axis=0))
        values[:, 3:] += shaken @ self.matrix("accel").T
        white = np.concatenate([
            unit.gyro_arw * self.effect("gyro_noise", 1.0), unit.accel_vrw * self.effect("accel_noise", 1.0)
        ])  # fmt: skip
        per_root_second = np.concatenate([
            DPH * self.effect("gyro_random_walk_dph_sqrt_h"), UG * self.effect("accel_random_walk_ug_sqrt_h")
        ]) / 60.0  # fmt: skip
        walk = self.walk + np.cumsum(per_root_second * np.sqrt(h) * self.random.standard_normal((count, 6)), axis=0)
        self.walk = walk[-1]
        values += walk * h + white * np.sqrt(h) * self.random.standard_normal((count, 6))
        clip = np.deg2rad(self.effect("gyro_clip_dps", np.inf)[0]) * h
        values[:, :3] = np.clip(values[:, :3], -clip, clip)
        self.produced += count
        lsb = np.repeat([unit.gyro_lsb, unit.accel_lsb], 3)
        if unit.output == "rate":
            return np.round(values / h / lsb)
        total = self.residue + np.cumsum(values / lsb, axis=0)
        whole = np.round(total)
        self.residue = total[-1] - whole[-1]
        return np.diff(whole, axis=0, prepend=0.0)

    def run(self, steps: Iterable[Any], stage: str, rounds: int | None = None) -> Samples:
        """Simulate the moves and rests of a plan."""
        first, parts = self.produced, []
        for step in steps:
            kind = type(step).__name__
            if kind == "Move":
                self.steps += 1
                duration = 0.0
                for joint, target in zip(self.joints, (step.outer, step.inner), strict=True):
                    if target != joint.target:
                        duration = max(duration, joint.move(self.now, target, step.rate, step.acceleration))
                        joint.errors.append(self.site.encoder_sigma * self.random.standard_normal())
                parts.append(self.produce(duration + SETTLE))
            elif kind == "Dwell":
                parts.append(self.produce(step.duration))
            elif kind == "RoundEnd" and rounds is not None and step.rounds >= rounds:
                break
        counts, angles, numbers = (np.concatenate(column) for column in zip(*parts, strict=True))
        seq = np.arange(first, self.produced)
        time = (seq + 1) / self.unit.sample_rate
        return Samples(seq, time, counts, angles, numbers.astype(np.int64), np.full(len(seq), 25.0))

    @property
    def parameters(self) -> dict[str, float]:
        """The 30 parameters at the end of the last sample."""
        found = dict(self.unit.parameters)
        grown = 1.0 - np.exp(-self.now / self.effect("warm_up_s", 300.0)[0])
        stepped = self.now > self.effect("jump_at_s", 600.0)[0]
        for k, (sensor, unit, bias) in enumerate((("gyro", DPH, "dph"), ("accel", UG, "ug"))):
            scale = 1e-6 * grown * self.effect(f"warm_up_{sensor}_scale_ppm")
            drift = unit * grown * self.effect(f"warm_up_{sensor}_bias_{bias}")
            drift = drift + unit * stepped * self.effect(f"{sensor}_jump_{bias}") + self.walk[3 * k : 3 * k + 3]
            for name in [name for name in found if name.startswith(sensor)]:
                i = AXES.index(name[-2] if name[-2] in AXES else name[-1])
                found[name] *= 1.0 + scale[i]
                found[name] += {f"{sensor}_scale": scale[i], f"{sensor}_bias": drift[i]}.get(name[:-2], 0.0)
        return found
