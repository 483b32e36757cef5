"""Piece-wise constant observability analysis of a navigation stage: stripped observability matrix and its SVD.

Each piece with constant F contributes H, H F T, H (F T)²/2, ... (D. Goshen-Meskin and I. Y. Bar-Itzhack,
*Observability analysis of piece-wise constant systems*, IEEE Trans. AES 28(4), 1992), with states scaled by their prior
sigma and observations by their noise. Rotations are divided into pieces of 5° or less; a rest is one piece. The
strength of a state is computed from the total matrix, whose rows refer to the state at the start of the stage: unlike
the stripped matrix it contains the information in the angle of a rotation.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from calstation.estimation import Ranking
from calstation.estimation.common import Belief, SolveContext, StageData, filter_noise
from calstation.estimation.navigation.filter import POSITION_SIGMA, History
from calstation.physics import NAMES, OBSERVABLE, STATES, FloatArray, compensation, dynamics, rotation_rate, skew

STATE_NAMES = (
    *(f"{s}_{a}" for s in ("attitude_error", "velocity_error", "position_error") for a in ("east", "north", "up")),
    *NAMES,
)
#: Largest rotation of a piece, rad.
LARGEST_TURN = np.deg2rad(5.0)
#: Number of powers of F used: φ → δv → δp and the biases need four; each additional power adds earth rate times T.
POWERS = 6


def pieces(data: StageData, history: History) -> Iterator[tuple[int, int]]:
    """Yield the observations (first, last + 1) of each piece, split at steps, every 5° and between motion and rest."""
    index = history.index
    step = data.step[index - 1]
    rate = np.linalg.norm(history.rate, axis=1)
    moving = rate > np.deg2rad(0.5)
    elapsed = np.diff(index, prepend=index[0]) * data.dt
    first, turned = 0, 0.0
    for k in range(1, len(index) + 1):
        if k < len(index):
            turned += rate[k] * elapsed[k] if moving[k] else 0.0
            same = step[k] == step[first] and moving[k] == moving[first] and turned <= LARGEST_TURN
            if same:
                continue
        yield first, k
        first, turned = k, 0.0


class ObservabilityAnalysis:
    """Observability of the states after each step; takes the observations of a stage in order, all at once or live.

    `point` contains the parameters of the linearisation, SI, shape (30,).
    """

    def __init__(self, context: SolveContext, prior: Belief, point: FloatArray) -> None:
        self._context, self._point = context, point
        noise = filter_noise(context)
        self._interval, self._velocity = noise.interval, np.sqrt(noise.velocity)
        tilt = context.table.mount_sigma
        azimuth = np.hypot(tilt, context.table.azimuth_sigma)
        self._scale = np.array([tilt, tilt, azimuth, *[self._velocity] * 3, *[POSITION_SIGMA] * 3, *prior.sigma])
        self._R, self._total, self._carried = np.zeros((STATES, STATES)), np.zeros((STATES, STATES)), np.eye(STATES)
        self._step: int | None = None
        self._seqs, self._count = (0, 0), 0
        self._segments: list[dict[str, Any]] = []
        self._by_step: list[FloatArray] = []

    def take(self, data: StageData, history: History) -> None:
        """Add observations, whose indices refer to `data`."""
        index = history.index
        if not len(index):
            return
        steps, seqs = data.step[index - 1], data.seq[index - 1]
        for a, b in pieces(data, history):
            if steps[a] != self._step:
                self._end_step()
                self._step, self._seqs, self._count = int(steps[a]), (int(seqs[a]), 0), 0
            middle = (a + b) // 2
            T = float(index[b - 1] - index[a - 1] if a else index[b - 1] - index[0] + 1) * data.dt
            rows, transition = _piece(
                self._context, self._point, history.attitude[middle], history.rate[middle], max(T, self._interval)
            )
            weight = np.sqrt(b - a) / self._velocity
            self._R = _stacked(self._R, rows * self._scale * weight)
            self._total = _stacked(self._total, rows @ self._carried * self._scale * weight)
            self._carried = transition @ self._carried
            self._count += 1
            self._seqs = (self._seqs[0], int(seqs[b - 1]))

    def _end_step(self) -> None:
        if self._step is not None:
            self._segments.append(self._segment())
            self._by_step.append(self._strengths())

    def _singular_values(self) -> FloatArray:
        return np.asarray(np.linalg.svd(self._R, compute_uv=False))

    def _strengths(self) -> FloatArray:
        """Return the prior sigma divided by the sigma from the total matrix, shape (39,)."""
        left = np.linalg.inv(np.eye(STATES) + self._total.T @ self._total)
        return np.asarray(1.0 / np.sqrt(np.diag(left)))

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

    def found(self) -> dict[str, Any]:
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
            seen = [k for k, s in enumerate(strengths) if s > 1.0 / OBSERVABLE]
            states[name] = {
                "step": self._segments[seen[0]]["step"] if seen else None,
                "strength": float(f"{strengths[-1]:.4g}") if strengths else 1.0,
                "by_step": [float(f"{s:.3g}") for s in strengths],
            }
        return {"segments": self._segments, "states": states}


def observability_analysis(
    data: StageData, history: History, context: SolveContext, prior: Belief, point: FloatArray
) -> dict[str, Any]:
    """Analyse all observations of a stage, see `ObservabilityAnalysis.found`."""
    analysis = ObservabilityAnalysis(context, prior, point)
    analysis.take(data, history)
    return analysis.found()


def _stacked(R: FloatArray, rows: FloatArray) -> FloatArray:
    """Append `rows` to the triangular factor R, shape (39, 39), and return the updated factor."""
    return np.asarray(np.linalg.qr(np.vstack([R, rows]), mode="r"))


def _piece(
    context: SolveContext, point: FloatArray, C: FloatArray, omega: FloatArray, T: float
) -> tuple[FloatArray, FloatArray]:
    """Return the rows H (F T)^k / k! of a piece, shape (3 POWERS, 39), and its transition exp(F T), shape (39, 39)."""
    c = compensation(point)
    earth = rotation_rate(context.site.latitude)
    w = omega - C.T @ earth
    force = C.T @ np.array([0.0, 0.0, context.site.local_gravity]) + np.cross(w, np.cross(w, c.outer_lever))
    rate_jacobian, force_jacobian = dynamics(c, omega, force)
    F = np.zeros((STATES, STATES))
    F[0:3, 0:3] = -skew(earth)
    F[3:6, 3:6] = -2.0 * skew(earth)
    F[3:6, 0:3] = -skew(C @ force)
    F[6:9, 3:6] = np.eye(3)
    F[0:3, 9:36] = C @ rate_jacobian
    F[3:6, 9:36] = C @ force_jacobian
    H = np.zeros((3, STATES))
    H[:, 0:3] = skew(C @ np.cross(w, c.outer_lever))
    H[:, 3:6] = np.eye(3)
    H[:, 9:36] = C @ skew(c.outer_lever) @ rate_jacobian
    H[:, 36:39] = -C @ skew(w)
    rows, row, term, transition = [], H, np.eye(STATES), np.eye(STATES)
    for k in range(POWERS):
        rows.append(row)
        row = row @ F * (T / (k + 1))
        term = term @ F * (T / (k + 1))
        transition += term
    return np.vstack(rows), transition
