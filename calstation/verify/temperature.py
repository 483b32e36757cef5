"""The stage `temperature`: polynomials of the temperature, lags and hysteresis, from all points at once.

A result states the points, which are parts of the samples, and which coefficients they determine.
"""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
from scipy.linalg import block_diag, solve_banded

from .estimate import Joint, motion_equations, solve
from .samples import AT, BIASES, COUNT, GROUP, NAMES, NotCoveredError, stages_of

#: Element, gyros (0) or accelerometers (1), on whose temperature a parameter depends; groups with a hysteresis.
ELEMENT, HYSTERETIC = np.array([int(not group.startswith("gyro")) for group in GROUP]), [*AT][:7]
#: Duration of mean temperatures and sigma of a lag, s; lowest Allan deviation of a bias per sigma of its drift.
INTERVAL, LAG_SIGMA, ALLAN = 10.0, 60.0, np.sqrt(2.0 * np.log(2.0) / np.pi) / 1.375
#: Half widths of the loops of a hysteresis, K, and their states before the first point; sizes that are compared.
WIDTHS, STATES, SIZES = np.repeat([2.0, 4.0, 8.0, 16.0], 3), np.tile([-1.0, 0.0, 1.0], 4), np.geomspace(0.01, 1e3, 120)
#: Twice the logarithm of the ratio of likelihoods from which a group other than the biases has a hysteresis.
SIGNIFICANT = 2.7


def coefficients(stated):
    """Return name and value of each coefficient that a result states, and their covariance."""
    values = {}
    for name, row in stated.get("coefficients", {}).items():
        values |= {f"{name}[{power}]": float(value) for power, value in enumerate(row["values"])}
        values |= {f"{name}[rate]": float(row["rate"]["value"])} if row.get("rate") else {}
    return [*values.items()], stated.get("covariance", [])


class Course:
    """Temperature of the sensor, °C, over time, s, as means of the samples of a stage or a point."""

    def __init__(self, samples, dt):
        known, self.nodes = np.isfinite(samples.temperature), np.linspace(*samples.seq[[0, -1]], 201) * dt
        if np.count_nonzero(known) * dt < 2.0 * INTERVAL:
            raise NotCoveredError("a point without temperatures")
        time = samples.seq[known] * dt
        starts = np.flatnonzero(np.diff(np.floor((time - time[0]) / INTERVAL), prepend=-1.0))
        count = np.diff(starts, append=len(time))
        self.time, self.sensed = (np.add.reduceat(x, starts) / count for x in (time, samples.temperature[known]))
        self.mean = samples.temperature[known].mean()

    def at(self, lag, time):
        """Return temperature, °C, and rate, K/min, of an element that lags, or precedes by a negative lag, s."""
        T = self.sensed - min(lag, 0.0) * np.gradient(self.sensed, self.time)
        if lag > 0.0:  # a low-pass of first order
            decay = np.exp(-np.diff(self.time) / lag)
            behind = lag * np.diff(T) / np.diff(self.time) * (decay - 1.0)
            T = T + solve_banded((1, 0), [np.ones(len(T)), np.r_[-decay, 0.0]], np.r_[0.0, behind])
        return np.interp(time, self.time, T), 60.0 * np.interp(time, self.time, np.gradient(T, self.time))


class OverTemperature:
    """The unknowns are lags of gyros and accelerometers, s, and coefficients by `owner` and `power` (−1: of the rate).

    Coefficients are scaled: the temperature counts from the reference in units of `span`, its rate in K/min.
    """

    def __init__(self, log, stage, stated, prior):
        points, section, s = stated["points"], log.setting.meta["temperature"], log.setting
        self.prior, self.reference, self.range = prior, section["reference_c"], section["range_c"]
        self.span, self.setting = np.abs(np.subtract(self.range, self.reference)).max(), s
        rows = {name: (len(row["values"]), bool(row.get("rate"))) for name, row in stated["coefficients"].items()}
        powers = [[*range(count), *[-1] * has_rate] for count, has_rate in (rows.get(n, (1, False)) for n in NAMES)]
        self.owner, self.power = np.array([(i, power) for i in range(COUNT) for power in powers[i]]).T
        self.names = tuple(
            f"{NAMES[i]}[{k if k >= 0 else 'rate'}]" for i, k in zip(self.owner, self.power, strict=True)
        )
        self.constant, self.selection = np.flatnonzero(self.power == 0), np.eye(COUNT)[self.owner]
        samples = [stages_of(log, point["first_seq"], point["last_seq"])["temperature"] for point in points]
        ratios = [max(point.get("table_noise") or 1.0, 1.0) for point in points]
        settings = [SimpleNamespace(**{**vars(s), "velocity": s.velocity * ratio**2}) for ratio in ratios]
        is_ramp = any(one["last_seq"] + 1 == other["first_seq"] for one, other in pairwise(points))
        self.parts = [Course(each, s.dt) for each in samples]
        self.courses = [Course(stage, s.dt)] * len(points) if is_ramp else self.parts
        fitted = [k for k, point in enumerate(points) if not point["held_out"]]
        self.solvers = {k: motion_equations(samples[k], settings[k], prior) for k in fitted}
        self.own = dict.fromkeys(fitted, prior.mean)
        sigma = np.r_[[LAG_SIGMA * is_ramp] * 2, prior.sigma[self.owner]]
        mean, covariance, at_reference = np.zeros(len(sigma)), np.diag(sigma**2), 2 + self.constant
        mean[at_reference], covariance[np.ix_(at_reference, at_reference)] = prior.mean, prior.covariance
        before = Joint(np.outer(mean, [0.0, 0.0, 0.0, 1.0]), covariance, np.zeros((0, 4)))
        solve("temperature", self.linearise, before, np.arange(len(mean)))
        self.joint, self.hysteresis = self._with_hysteresis(before)

    def terms(self, k, lags, time=None):
        """Return the parameters at times in point k, s, or at its mean, per unit of the coefficients, shape (n, c)."""
        courses = np.array([self.courses[k].at(lag, self.parts[k].nodes if time is None else time) for lag in lags])
        courses = courses if time is not None else courses.mean(axis=2, keepdims=True)
        T, rate = courses[ELEMENT[self.owner]].transpose(1, 2, 0)
        return np.where(self.power < 0, rate, ((T - self.reference) / self.span) ** np.maximum(self.power, 0))

    def linearise(self, unknowns):
        """Return the equations of all fitted points, see `solve`."""
        self.unknowns, self.equations = unknowns, {k: self._of_point(k, unknowns) for k in self.solvers}
        return np.vstack([rows for _, rows in self.equations.values()]), lambda change: None

    def _of_point(self, k, unknowns):
        """Return equations of the parameters at the mean temperature of a point, about its own solution, and of all."""
        lags, sizes, own, ends = unknowns[:2], unknowns[2:], self.own[k], self.parts[k].nodes[[0, -1]]
        terms = self.terms(k, lags)[0]
        mean = (terms * sizes) @ self.selection
        # approximately, a lag delays the temperature
        by_time = np.diff(self.terms(k, lags, ends), axis=0)[0] * (self.power >= 0) * sizes / np.diff(ends)
        by_lag = -(by_time @ self.selection)[:, None] * (ELEMENT[:, None] == [0, 1])
        by_unknowns = np.hstack([by_lag, terms * self.selection.T])
        equations, move = self.solvers[k](own, lambda time: (self.terms(k, lags, time) * sizes) @ self.selection - mean)
        J, misclosure = np.split(np.linalg.qr(equations, mode="r"), [COUNT], axis=1)
        self.own[k] = self.prior.updated(np.hstack([J, misclosure]), own).mean
        move(self.own[k] - own)
        return J, np.hstack([J @ by_unknowns, misclosure + J @ (mean - own)[:, None]])

    def _loops(self, lags):
        """Return the mean of each loop in every point for gyros and accelerometers, shape (points, 2, loops)."""
        means, middles = [], None
        for course, part in zip(self.courses, self.parts, strict=True):
            T = np.array([course.at(lag, part.nodes)[0].mean() for lag in lags])[:, None]
            middles, total = T - WIDTHS * STATES if middles is None else middles, 0.0
            first, last = np.sort(part.sensed)[[0, -1] if part.sensed[-1] >= part.sensed[0] else [-1, 0]]
            for value in np.linspace(first, last, 9) - part.mean:
                middles = np.clip(middles, T + value - WIDTHS, T + value + WIDTHS)
                total = total + (T + value - middles) / WIDTHS
            means.append(total / 9)
        return np.array(means) / np.sqrt(len(WIDTHS))

    def _with_hysteresis(self, before):
        """Return the estimate with the loops as further unknowns, the first ones, and the parameter of each of them."""
        rows, loops = np.vstack([rows for _, rows in self.equations.values()]), self._loops(self.unknowns[:2])
        each = {k: (J[:, :, None] * loops[k, ELEMENT]) for k, (J, _) in self.equations.items()}
        columns = {g: np.vstack([C[:, AT[g]].reshape(len(C), -1) for C in each.values()]) for g in HYSTERETIC}
        ups = np.diff([part.mean for part in self.parts], prepend=np.nan)[[*self.solvers]]
        has_loops = min(np.count_nonzero(ups > 0.0), np.count_nonzero(ups < 0.0)) >= 2
        residual, free = rows[:, :-1] @ self.unknowns - rows[:, -1], before.sigma > 0.0
        free[[-3, -2]] = self.setting.offset_sigma > 0.0
        sizes = _sizes(rows[:, :-1][:, free], residual, columns) if has_loops else {}
        parameters = np.repeat([i for group in sizes for i in AT[group]], len(WIDTHS)).astype(int)
        variances = [sizes[GROUP[i]] ** 2 for i in parameters]
        response = np.vstack([np.zeros((len(parameters), 4)), before.response])
        joint = Joint(response, block_diag(np.diag(variances), before.covariance), before.aside)
        point = np.r_[np.zeros(len(parameters)), self.unknowns]
        return joint.updated(np.hstack([*(columns[group] for group in sizes), rows]), point), parameters

    def complete(self, *offset_and_gravity):
        """Return the estimate of the parameters at the reference and of the coefficients, SI, see `Joint`."""
        mean, covariance, part = self.joint.complete(*offset_and_gravity)
        first, variance = len(self.hysteresis) + 2, np.zeros(COUNT)
        variance[BIASES] = (ALLAN * self.setting.drift) ** 2
        for group in dict.fromkeys(GROUP[i] for i in self.hysteresis):  # in use, after the temperature has risen
            loops = [np.flatnonzero(self.hysteresis == i) for i in AT[group]]
            squares = [mean[at].sum() ** 2 + covariance[np.ix_(at, at)].sum() for at in loops]
            variance[AT[group]] += np.mean(squares) / len(WIDTHS)
        constant = first + self.constant
        covariance[constant, constant] += variance * (self.prior.sigma > 0.0)
        order = np.r_[constant, np.arange(first, len(mean))]
        scale = np.r_[np.ones(COUNT), np.where(self.power < 0, 60.0, self.span ** -np.maximum(self.power, 0.0))]
        return scale * mean[order], *(P[np.ix_(order, order)] * np.outer(scale, scale) for P in (covariance, part))

    def over_range(self, i):
        """Return a parameter at temperatures over the range per unit of each of `complete`, shape (101, 33 + c)."""
        T = np.linspace(*self.range, 101)[:, None] - self.reference
        of_parameter = (self.owner == i) & (self.power >= 0)
        return np.hstack([np.zeros((len(T), COUNT)), np.where(of_parameter, T ** np.maximum(self.power, 0), 0.0)])


def _sizes(A, residual, columns):
    """Return the sigma of the loops of each group with a hysteresis, SI, from the residual of equations without any.

    Its variance is the mean given the residual (n,), if the share of noise in it is distributed uniformly before. `A`
    are the columns of the unknowns (n, u), `columns` those of the loops by group.
    """
    basis = np.linalg.svd(A / np.linalg.norm(A, axis=0), full_matrices=False)[0]
    columns, sizes = {group: C - basis @ (basis.T @ C) for group, C in columns.items()}, {}
    residual = residual - basis @ (basis.T @ residual)
    while columns:
        parts = {group: np.linalg.svd(C, full_matrices=False)[:2] for group, C in columns.items()}
        ratios = {group: np.outer(SIZES, v / v[0]) ** 2 for group, (_, v) in parts.items()}
        fits = {group: (u.T @ residual) ** 2 for group, (u, _) in parts.items()}
        gains = {g: np.sum(fits[g] * r / (1.0 + r) - np.log1p(r), axis=1) for g, r in ratios.items()}
        group = max(gains, key=lambda g: gains[g].max())
        if gains[group].max() <= SIGNIFICANT:
            columns = {g: C for g, C in columns.items() if g in ("gyro_bias", "accel_bias")}
            if not columns:
                break
            group = next(iter(columns))
        (u, v), likelihood = parts[group], np.exp(0.5 * (gains[group] - gains[group].max()))
        weights = likelihood * SIZES**2 / (1.0 + SIZES**2) ** 2
        sizes[group] = np.sqrt(weights @ SIZES**2 / weights.sum()) / v[0]
        # white equations of what the hysteresis of this group leaves
        change = u * (1.0 / np.sqrt(1.0 + (sizes[group] * v) ** 2) - 1.0)
        residual = residual + change @ (u.T @ residual)
        columns = {g: C + change @ (u.T @ C) for g, C in columns.items() if g != group}
    return sizes
