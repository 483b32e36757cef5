"""Errors of a unit outside the 30-parameter model: other terms, delays, and changes over time."""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from calstation.physics import PARAMETERS, FloatArray

_Row = tuple[float, float, float]
#: One value for all axes, or one for each axis.
Axes = float | _Row
#: Magnitude of the coefficients, whose signs are drawn, or the coefficients, with a row for each sensor.
Coefficients = float | tuple[_Row, _Row, _Row]
NonNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]

_G = 9.80665
_DEGREE_PER_HOUR = np.deg2rad(1.0) / 3600.0
_PPM = 1e-6
#: Rate at which the nonlinearity of the gyros is specified, rad/s.
_RATE = np.deg2rad(100.0)

_SENSORS = ("gyro", "accel")
#: Rate above which the unit is considered to turn, rad/s.
_MIN_TURN_RATE = np.deg2rad(1.0)
#: Smallest angle about an axis that counts as a turn, rad.
_MIN_TURN_ANGLE = np.deg2rad(1.0)

#: First row of each coefficient in `EffectTruth.terms`: effects with a value per channel, and matrices of three rows.
#: The compiled code of an `@kernel` in `imu.py` contains them; by this word, `discard_outdated` includes this file.
ACCEL_CUBIC, ACCEL_ASYMMETRY, GYRO_ASYMMETRY, GYRO_SQUARE, GYRO_CUBIC = range(5)
G_SENSITIVITY, ACCEL_CROSS, ACCEL_RATE_SQUARE, GYRO_FLEX, GYRO_G_SQUARE = range(5, 20, 3)
ACCEL_FIFTH, GYRO_FIFTH, ACCEL_MOVING_BIAS, GYRO_MOVING_BIAS = range(20, 24)
TERM_ROWS = 24


@dataclass(frozen=True)
class EffectTruth:
    """The errors of one unit outside the model, SI; arrays of shape (6,) are gyros x, y, z, then accelerometers.

    `terms`, shape (`TERM_ROWS`, 3), are the coefficients of f_i³ (s⁴/m²), |f_i| (1), |ω_i| (1), ω_i² (s/rad), ω_i³
    (s²/rad²), the gyros' matrix of f (3 rows, s/m), and the accelerometers' matrix of (f_y f_z, f_z f_x, f_x f_y)
    (3 rows, s²/m), the accelerometers' matrix of (ω_x², ω_y², ω_z²) (3 rows, m), the matrix K of the rotation K f
    of the gyros relative to the accelerometers (3 rows, rad s²/m), the gyros' matrix of (f_x², f_y², f_z²) (3 rows,
    rad s³/m²), f_i⁵ (s⁸/m⁴), ω_i⁵ (s⁴/rad⁴), and the biases of accelerometers (m/s²) and gyros (rad/s) while a
    joint turns, where f and ω are sensed by the unit. Row i of `off_axis` is the displacement of accelerometer i,
    m, shape (3, 3). The channels have delays of `delay` s, and then a first-order low-pass of time constant
    `low_pass` s; the gyro increments are then compensated for coning by the share `coning_compensation`. After a
    turn in the positive sense, the biases of the gyros are larger by `bias_hysteresis`, rad/s, and their scale
    factors by `scale_hysteresis`; after a negative turn, they are smaller by the same amount, both of shape (3,).
    The unit samples at (1 + `clock`) times the nominal rate. The gyros clip at `gyro_clip`, rad/s. The scale
    factors have changed since time 0 by (1 − e^(−t/`warm_up_time`)) `warm_up_scale`, and the biases by the same
    fraction of `warm_up_bias`, by `jump` after `jump_time`, and by a random walk of intensity `walk` per √s.
    """

    terms: FloatArray = field(default_factory=lambda: np.zeros((TERM_ROWS, 3)))
    off_axis: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    delay: FloatArray = field(default_factory=lambda: np.zeros(6))
    low_pass: float = 0.0
    coning_compensation: float = 0.0
    bias_hysteresis: FloatArray = field(default_factory=lambda: np.zeros(3))
    scale_hysteresis: FloatArray = field(default_factory=lambda: np.zeros(3))
    clock: float = 0.0
    gyro_clip: float = np.inf
    warm_up_time: float = 300.0
    warm_up_scale: FloatArray = field(default_factory=lambda: np.zeros(6))
    warm_up_bias: FloatArray = field(default_factory=lambda: np.zeros(6))
    jump: FloatArray = field(default_factory=lambda: np.zeros(6))
    jump_time: float = 0.0
    walk: FloatArray = field(default_factory=lambda: np.zeros(6))

    @property
    def changing(self) -> bool:
        """Whether the errors change over time."""
        hysteresis = np.any([self.bias_hysteresis, self.scale_hysteresis])
        return bool(hysteresis or np.any([self.warm_up_scale, self.warm_up_bias, self.jump, self.walk]))


class Changes:
    """The changes over time of a unit with `gyro_bias`, rad/s, shape (3,), continuous over successive calls."""

    def __init__(
        self, effects: EffectTruth, interval: float, random: np.random.Generator, gyro_bias: FloatArray
    ) -> None:
        self._effects, self._interval, self._random, self._gyro_bias = effects, interval, random, gyro_bias
        self._walk = np.zeros((1, 6))
        #: Sense of the last completed turn about each gyro's axis, and angle of the current one, rad.
        self._last_turn_senses, self._angle = np.zeros(3), np.zeros(3)

    def apply(self, increments: FloatArray, first: int) -> None:
        """Change the increments of the samples from number `first` on in place, rad and m/s, shape (n, 6)."""
        effects, interval = self._effects, self._interval
        times = np.asarray((first + 0.5 + np.arange(len(increments)))[:, None] * interval, dtype=np.float64)
        steps = effects.walk * np.sqrt(interval) * self._random.standard_normal(increments.shape)
        walk = np.cumsum(np.vstack([self._walk, steps]), axis=0)
        self._walk = walk[-1:]
        if np.any([effects.bias_hysteresis, effects.scale_hysteresis]):
            senses = self._last_turns(increments[:, :3] / interval - self._gyro_bias)
            increments[:, :3] *= 1.0 + senses * effects.scale_hysteresis
            increments[:, :3] += senses * effects.bias_hysteresis * interval
        increments *= 1.0 + self._warm_up(times) * effects.warm_up_scale
        increments += (self._bias(times) + walk[1:]) * interval

    def _last_turns(self, rates: FloatArray) -> FloatArray:
        """Return the sense of the last turn from rest to rest at each sample, ±1, or 0 before a turn, shape (n, 3)."""
        senses = np.empty_like(rates)
        for n, rate in enumerate(rates):
            if np.abs(rate).max() > _MIN_TURN_RATE:
                self._angle = self._angle + rate * self._interval
            elif self._angle.any():
                has_turned = np.abs(self._angle) > _MIN_TURN_ANGLE
                self._last_turn_senses = np.where(has_turned, np.sign(self._angle), self._last_turn_senses)
                self._angle = np.zeros(3)
            senses[n] = self._last_turn_senses
        return senses

    def parameters(self, parameters: FloatArray, time: float) -> FloatArray:
        """Return the unit's 30 parameters at `time`, s, the end of the last sample, given their values at time 0."""
        scale, bias = self._warm_up(time) * self._effects.warm_up_scale, self._bias(time) + self._walk[0]
        changed = parameters.copy()
        for i, p in enumerate(PARAMETERS):
            if p.sensor in _SENSORS:
                channel = 3 * _SENSORS.index(p.sensor) + p.row
                added = scale if p.group.endswith("_scale") else bias if p.group.endswith("_bias") else np.zeros(6)
                changed[i] = changed[i] * (1.0 + scale[channel]) + added[channel]
        return changed

    def _warm_up(self, times: FloatArray | float) -> FloatArray:
        return np.asarray(-np.expm1(-times / self._effects.warm_up_time))

    def _bias(self, times: FloatArray | float) -> FloatArray:
        effects = self._effects
        return np.asarray(self._warm_up(times) * effects.warm_up_bias + (times > effects.jump_time) * effects.jump)


class Effects(BaseModel):
    """Settings of the errors outside the model; `docs/reference/bench.md` explains every entry."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    accel_cubic_ug_g3: Axes = 0.0
    accel_cross_ug_g2: Coefficients = 0.0
    accel_asymmetry_ppm: Axes = 0.0
    accel_off_axis_mm: Coefficients = 0.0
    accel_delay_ms: Axes = 0.0
    accel_fifth_ug_g5: Axes = 0.0
    accel_moving_bias_ug: Axes = 0.0
    accel_rate_square_ug: Coefficients = 0.0
    accel_noise: NonNegative = 1.0
    accel_random_walk_ug_sqrt_h: Axes = 0.0
    gyro_square_ppm: Axes = 0.0
    gyro_cubic_ppm: Axes = 0.0
    gyro_asymmetry_ppm: Axes = 0.0
    gyro_delay_ms: Axes = 0.0
    gyro_fifth_ppm: Axes = 0.0
    gyro_flex_urad_g: Coefficients = 0.0
    coning_compensation: float = 0.0
    gyro_g_square_dph_g2: Coefficients = 0.0
    gyro_hysteresis_dph: Axes = 0.0
    gyro_moving_bias_dph: Axes = 0.0
    gyro_scale_hysteresis_ppm: Axes = 0.0
    low_pass_ms: NonNegative = 0.0
    gyro_clip_dps: Positive = np.inf
    gyro_noise: NonNegative = 1.0
    gyro_random_walk_dph_sqrt_h: Axes = 0.0
    g_sensitivity_dph_g: Coefficients = 0.0
    sample_clock_ppm: float = 0.0
    warm_up_gyro_scale_ppm: Axes = 0.0
    warm_up_accel_scale_ppm: Axes = 0.0
    warm_up_gyro_bias_dph: Axes = 0.0
    warm_up_accel_bias_ug: Axes = 0.0
    warm_up_s: Positive = 300.0
    gyro_jump_dph: Axes = 0.0
    accel_jump_ug: Axes = 0.0
    jump_at_s: float = 600.0

    def draw(self, random: np.random.Generator) -> EffectTruth:
        """Return the effects of one unit, SI, with signs drawn from `random` unless they are specified."""
        signs = random.choice([-1.0, 1.0], (6, 3, 3))
        signs[1:3] *= 1.0 - np.eye(3)
        values = {
            ACCEL_CUBIC: _axes(self.accel_cubic_ug_g3, _PPM / _G**2),
            ACCEL_ASYMMETRY: _axes(self.accel_asymmetry_ppm, _PPM),
            GYRO_ASYMMETRY: _axes(self.gyro_asymmetry_ppm, _PPM),
            GYRO_SQUARE: _axes(self.gyro_square_ppm, _PPM / _RATE),
            GYRO_CUBIC: _axes(self.gyro_cubic_ppm, _PPM / _RATE**2),
            G_SENSITIVITY: _coefficients(self.g_sensitivity_dph_g, signs[0], _DEGREE_PER_HOUR / _G),
            ACCEL_CROSS: _coefficients(self.accel_cross_ug_g2, signs[1], _PPM / _G),
            ACCEL_RATE_SQUARE: _coefficients(self.accel_rate_square_ug, signs[3], _PPM * _G / _RATE**2),
            GYRO_FLEX: _coefficients(self.gyro_flex_urad_g, signs[4], _PPM / _G),
            GYRO_G_SQUARE: _coefficients(self.gyro_g_square_dph_g2, signs[5], _DEGREE_PER_HOUR / _G**2),
            ACCEL_FIFTH: _axes(self.accel_fifth_ug_g5, _PPM / _G**4),
            GYRO_FIFTH: _axes(self.gyro_fifth_ppm, _PPM / _RATE**4),
            ACCEL_MOVING_BIAS: _axes(self.accel_moving_bias_ug, _PPM * _G),
            GYRO_MOVING_BIAS: _axes(self.gyro_moving_bias_dph, _DEGREE_PER_HOUR),
        }
        terms = np.zeros((TERM_ROWS, 3))
        for row, value in values.items():
            terms[row : row + len(np.atleast_2d(value))] = value
        return EffectTruth(
            terms=terms,
            off_axis=_coefficients(self.accel_off_axis_mm, signs[2], 1e-3),
            delay=_both(self.gyro_delay_ms, self.accel_delay_ms, 1e-3, 1e-3),
            low_pass=1e-3 * self.low_pass_ms,
            coning_compensation=self.coning_compensation,
            bias_hysteresis=_axes(self.gyro_hysteresis_dph, _DEGREE_PER_HOUR),
            scale_hysteresis=_axes(self.gyro_scale_hysteresis_ppm, _PPM),
            clock=_PPM * self.sample_clock_ppm,
            gyro_clip=float(np.deg2rad(self.gyro_clip_dps)),
            warm_up_time=self.warm_up_s,
            warm_up_scale=_both(self.warm_up_gyro_scale_ppm, self.warm_up_accel_scale_ppm, _PPM, _PPM),
            warm_up_bias=_both(self.warm_up_gyro_bias_dph, self.warm_up_accel_bias_ug),
            jump=_both(self.gyro_jump_dph, self.accel_jump_ug),
            jump_time=self.jump_at_s,
            walk=_both(self.gyro_random_walk_dph_sqrt_h, self.accel_random_walk_ug_sqrt_h) / 60.0,
        )


def _axes(values: Axes, unit: float) -> FloatArray:
    return np.asarray(np.broadcast_to(values, 3) * unit)


def _both(gyro: Axes, accel: Axes, gyro_unit: float = _DEGREE_PER_HOUR, accel_unit: float = _PPM * _G) -> FloatArray:
    return np.concatenate([_axes(gyro, gyro_unit), _axes(accel, accel_unit)])


def _coefficients(values: Coefficients, signs: FloatArray, unit: float) -> FloatArray:
    return np.asarray((values * signs if isinstance(values, float) else np.array(values)) * unit)
