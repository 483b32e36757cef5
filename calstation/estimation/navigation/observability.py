"""Piece-wise constant observability analysis of a navigation stage by the SVD of the stripped observability matrix.

Each piece with constant F contributes H, H F T, H (F T)²/2, ... (D. Goshen-Meskin and I. Y. Bar-Itzhack,
*Observability analysis of piece-wise constant systems*, IEEE Trans. AES 28(4), 1992). States are scaled by their prior
sigma and observations by their noise. Rotations are divided into pieces of at most 5°; a rest is one piece. The
strength of a state is computed from the total matrix, whose rows refer to the state at the start of the stage. Unlike
the stripped matrix, it contains the information in the angle of a rotation.
"""

from itertools import groupby, pairwise
from typing import Any

import numpy as np

from calstation.estimation.common import Posterior, SolveContext, StageData, filter_noise
from calstation.estimation.method import Ranking
from calstation.estimation.navigation.navigation_pass import POSITION_SIGMA, History
from calstation.physics import (
    DP,
    DV,
    NAMES,
    NAVIGATION,
    OBSERVABLE,
    OUTER_LEVER,
    PARAMETER_START,
    PHI,
    SENSORS,
    STATES,
    Compensation,
    FloatArray,
    IntArray,
    compensation,
    dynamics,
    kernel,
    rotation_rate,
)

STATE_NAMES = (
    *(f"{s}_{a}" for s in ("attitude_error", "velocity_error", "position_error") for a in ("east", "north", "up")),
    *NAMES,
)
#: Smallest rate of a rotation, rad/s; slower motion counts as rest.
REST_RATE = np.deg2rad(0.5)
#: Largest rotation of a piece, rad.
MAX_PIECE_ANGLE = np.deg2rad(5.0)
#: State index of the first parameter, states of the sensor parameters, and states of the outer lever arm.
_START, _SENSORS = PARAMETER_START, slice(PARAMETER_START, PARAMETER_START + SENSORS.stop)
_LEVER = slice(PARAMETER_START + OUTER_LEVER.start, STATES)
#: Number of powers of F: φ, δv, δp and the biases need four; each further power adds a factor of earth rate × T.
POWERS = 6


def pieces(data: StageData, history: History) -> list[tuple[int, int]]:
    """Return the observations (first, last + 1) of each piece, split at steps, every 5° and between motion and rest."""
    index = history.index
    elapsed = np.diff(index, prepend=index[0]) * data.dt
    edges = _edges(data.step[index - 1], np.linalg.norm(history.rate, axis=1), elapsed)
    return list(pairwise(edges.tolist()))


@kernel
def _edges(step: IntArray, rate: FloatArray, elapsed: FloatArray) -> IntArray:
    """Return the first observation of each piece, and the number of observations."""
    count = len(step)
    edges, last, angle = np.zeros(count + 1, np.int64), 0, 0.0
    for k in range(1, count):
        first, moving = edges[last], rate[k] > REST_RATE
        angle += rate[k] * elapsed[k] if moving else 0.0
        same = step[k] == step[first] and moving == (rate[first] > REST_RATE)
        if not (same and angle <= MAX_PIECE_ANGLE):
            last, angle = last + 1, 0.0
            edges[last] = k
    edges[last + 1] = count
    return edges[: last + 2]


class ObservabilityAnalysis:
    """Computes the observability of the states after each step from the observations of a stage, live or all at once.

    `point` contains the parameters about which the filter linearises, SI, shape (30,).
    """

    def __init__(self, context: SolveContext, prior: Posterior, point: FloatArray) -> None:
        noise = filter_noise(context)
        self._constants, self._gravity = compensation(point), context.site.local_gravity
        self._earth = rotation_rate(context.site.latitude)
        self._interval, self._velocity = noise.interval, np.sqrt(noise.velocity)
        tilt = context.table.mount_sigma
        azimuth = np.hypot(tilt, context.table.azimuth_sigma)
        self._scale = np.array([tilt, tilt, azimuth, *[self._velocity] * 3, *[POSITION_SIGMA] * 3, *prior.sigma])
        self._R, self._information, self._start_transition = np.zeros((STATES, STATES)), np.eye(STATES), np.eye(STATES)
        self._step: int | None = None
        self._seqs, self._count = (0, 0), 0
        self._segments: list[dict[str, Any]] = []
        self._by_step: list[FloatArray] = []

    def add(self, data: StageData, history: History) -> None:
        """Add observations, whose indices refer to `data`."""
        index = history.index
        if not len(index):
            return
        steps, seqs = data.step[index - 1], data.seq[index - 1]
        result = pieces(data, history)
        first, last = np.array(result).T
        time = (index[last - 1] - np.where(first > 0, index[first - 1], index[0] - 1)) * data.dt
        middle = (first + last) // 2
        rows, start_rows = _rows(
            self._constants, self._earth, self._gravity, history.attitude[middle], history.rate[middle],
            np.maximum(time, self._interval), self._start_transition,
        )  # fmt: skip
        weight = np.sqrt(last - first)[:, None, None] / self._velocity * self._scale
        for step, group in groupby(range(len(result)), lambda k: int(steps[first[k]])):
            members = list(group)
            if step != self._step:
                self._end_step()
                self._step, self._seqs, self._count = step, (int(seqs[first[members[0]]]), 0), 0
            part = slice(members[0], members[-1] + 1)
            stripped, total = ((x[part] * weight[part]).reshape(-1, STATES) for x in (rows, start_rows))
            self._R = np.asarray(np.linalg.qr(np.vstack([self._R, stripped]), mode="r"))
            self._information += total.T @ total
            self._count += len(members)
            self._seqs = (self._seqs[0], int(seqs[last[members[-1]] - 1]))

    def _end_step(self) -> None:
        if self._step is not None:
            self._segments.append(self._segment())
            self._by_step.append(self._strengths())

    def _singular_values(self) -> FloatArray:
        return np.asarray(np.linalg.svd(self._R, compute_uv=False))

    def _strengths(self) -> FloatArray:
        """Return the prior sigma divided by the sigma from the total matrix, shape (39,)."""
        return np.asarray(1.0 / np.sqrt(np.diag(np.linalg.inv(self._information))))

    def _segment(self) -> dict[str, Any]:
        singular = self._singular_values()
        return {
            "step": self._step,
            "first_seq": self._seqs[0],
            "last_seq": self._seqs[1],
            "pieces": self._count,
            "rank": int(np.count_nonzero(singular > 1.0)),
            "singular_values": [float(f"{s:.4g}") for s in singular],
        }

    def ranking(self) -> Ranking | None:
        """Return the observability so far; None before the first observation."""
        if self._step is None:
            return None
        strength = {name: float(f"{s:.3g}") for name, s in zip(STATE_NAMES, self._strengths(), strict=True)}
        return Ranking(self._step, int(np.count_nonzero(self._singular_values() > 1.0)), strength)

    def result(self) -> dict[str, Any]:
        """End the last step and return the analysis as JSON values.

        ``segments`` lists for each step its number, first and last sequence number, number of pieces, and the rank
        (singular values above 1) and singular values of the stripped matrix so far. ``states`` gives for each state the
        step in which it became observable (or None), its ``strength`` (prior sigma divided by the sigma from the total
        matrix, without process noise) and ``by_step``, the strength after each step.
        """
        self._end_step()
        self._step = None
        states = {}
        for i, name in enumerate(STATE_NAMES):
            strengths = [float(s[i]) for s in self._by_step]
            observable = [k for k, s in enumerate(strengths) if s > 1.0 / OBSERVABLE]
            states[name] = {
                "step": self._segments[observable[0]]["step"] if observable else None,
                "strength": float(f"{strengths[-1]:.4g}") if strengths else 1.0,
                "by_step": [float(f"{s:.3g}") for s in strengths],
            }
        return {"segments": self._segments, "states": states}


@kernel
def _rows(
    c: Compensation,
    earth: FloatArray,
    gravity: float,
    attitude: FloatArray,
    rate: FloatArray,
    time: FloatArray,
    start_transition: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the rows H (F T)^k / k! of k pieces, and these rows referred to the start, shape (k, 3 POWERS, 39) each.

    `start_transition` is the transition from the start to the first piece, shape (39, 39); it is updated in place to
    the end of the last piece. Nothing depends on δp, and only φ, δv and δp change, so six columns and nine rows of a
    power of F suffice.
    """
    powers = np.zeros((len(time), 3 * POWERS, STATES))
    first = np.zeros((len(time), 3 * POWERS, STATES))
    F, term, change = np.zeros((_START, STATES)), np.zeros((_START, STATES)), np.zeros((_START, STATES))
    for n in range(len(time)):
        C, omega, T, rows = attitude[n], rate[n], time[n], powers[n]
        w = omega - C.T @ earth
        force = C[2] * gravity + np.cross(w, np.cross(w, c.outer_lever))
        rate_jacobian, force_jacobian = dynamics(c, omega, force)
        F[PHI, PHI] = -_skew(earth)
        F[DV, DV] = -2.0 * _skew(earth)
        F[DV, PHI] = -_skew(C @ force)
        F[DP, DV] = np.eye(3)
        F[PHI, _SENSORS] = C @ rate_jacobian
        F[DV, _SENSORS] = C @ force_jacobian
        rows[:3, PHI] = _skew(C @ np.cross(w, c.outer_lever))
        rows[:3, DV] = np.eye(3)
        rows[:3, _SENSORS] = C @ _skew(c.outer_lever) @ rate_jacobian
        rows[:3, _LEVER] = -C @ _skew(w)
        for r in range(3, 3 * POWERS):
            _add_product(rows[r - 3], F, T / (r // 3), rows[r])
        for r in range(3 * POWERS):
            first[n, r, _START:] = rows[r, _START:]
            _add_product(rows[r], start_transition, 1.0, first[n, r])
        transition = F * T
        term[:] = transition
        for k in range(2, POWERS + 1):
            change[:] = 0.0
            for i in range(_START):
                _add_product(term[i], F, T / k, change[i])
            term[:] = change
            transition += term
        for i in range(_START):  # the transition minus identity
            change[i] = 0.0
            change[i, _START:] = transition[i, _START:]
            _add_product(transition[i], start_transition, 1.0, change[i])
        start_transition[NAVIGATION] += change
    return powers, first


@kernel
def _add_product(row: FloatArray, A: FloatArray, factor: float, out: FloatArray) -> None:
    """Add the first six columns of `row` times the first six rows of A, times `factor`, to `out`."""
    for k in range(DV.stop):
        t = row[k] * factor
        for j in range(STATES):
            out[j] += t * A[k, j]


@kernel
def _skew(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
