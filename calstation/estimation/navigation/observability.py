"""Piece-wise constant observability of a navigation stage: stripped observability matrix and its SVD.

Each piece with constant F contributes H, H F T, H (F T)²/2, ... (D. Goshen-Meskin and I. Y. Bar-Itzhack,
*Observability analysis of piece-wise constant systems*, IEEE Trans. AES 28(4), 1992), states scaled by their prior
sigma and observations by their noise. Rotations are cut into pieces of 5° or less; a rest is one piece. The strength
of a state comes from the total matrix, whose rows are carried back to the stage's start: unlike the stripped one it
contains the information in the length of a turn.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from calstation.estimation.common import Belief, SolveContext, StageData, filter_noise
from calstation.estimation.navigation.filter import POSITION_SIGMA, History
from calstation.physics import NAMES, STATES, FloatArray, IntArray, compensation, dynamics, rotation_rate, skew

STATE_NAMES = (
    *(f"{s}_{a}" for s in ("attitude_error", "velocity_error", "position_error") for a in ("east", "north", "up")),
    *NAMES,
)
#: Largest rotation of a piece, rad.
LARGEST_TURN = np.deg2rad(5.0)
#: Powers of F kept: φ → δv → δp and the biases need four; each further one adds earth rate times T.
POWERS = 6
#: A state is observable once its sigma is below this fraction of its prior sigma.
OBSERVABLE = 0.9


def pieces(data: StageData, history: History) -> Iterator[tuple[int, int]]:
    """Observations (first, last + 1) of each piece, cut at steps, at 5° of turn and between motion and rest."""
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


def observability_analysis(
    data: StageData, history: History, context: SolveContext, prior: Belief, point: FloatArray
) -> dict[str, Any]:
    """Observability of the states, step by step; `point` holds the parameters of the linearisation, SI, shape (30,).

    Returns a JSON-ready dict. ``segments``: per step its number, first and last sequence number, number of pieces, and
    rank (singular values above 1) and singular values of the stripped matrix so far. ``states``: per state the step in
    which it became observable (None if never), ``strength`` = prior sigma over the sigma that the total matrix leaves
    (without process noise), and ``by_step``, that strength after each step.
    """
    noise = filter_noise(context)
    tilt = context.table.mount_sigma
    azimuth = np.hypot(tilt, context.table.azimuth_sigma)
    velocity = np.sqrt(noise.velocity)
    scale = np.array([tilt, tilt, azimuth, *[velocity] * 3, *[POSITION_SIGMA] * 3, *prior.sigma])
    index, attitude, rate = history.index, history.attitude, history.rate
    steps: IntArray = data.step[index - 1]
    R, total, carried = np.zeros((STATES, STATES)), np.zeros((STATES, STATES)), np.eye(STATES)
    segments: list[dict[str, Any]] = []
    by_step: list[FloatArray] = []
    last_step, count, first = None, 0, 0
    for a, b in [*pieces(data, history), (len(index), len(index))]:
        if last_step is not None and (a == len(index) or steps[a] != last_step):
            singular = np.linalg.svd(R, compute_uv=False)
            segments.append(
                {
                    "step": int(last_step),
                    "first_seq": int(data.seq[index[first] - 1]),
                    "last_seq": int(data.seq[index[a - 1] - 1]),
                    "pieces": count,
                    "rank": int(np.count_nonzero(singular > 1.0)),
                    "singular_values": [float(f"{s:.4g}") for s in singular],
                }
            )
            left = np.linalg.inv(np.eye(STATES) + total.T @ total)
            by_step.append(1.0 / np.sqrt(np.diag(left)))
            count, first = 0, a
        if a == len(index):
            break
        last_step = steps[a]
        middle = (a + b) // 2
        T = float(index[b - 1] - index[a - 1] if a else index[b - 1] - index[0] + 1) * data.dt
        rows, transition = _piece(context, point, attitude[middle], rate[middle], max(T, noise.interval))
        weight = np.sqrt(b - a) / velocity
        R = _stacked(R, rows * scale * weight)
        total = _stacked(total, rows @ carried * scale * weight)
        carried = transition @ carried
        count += 1
    states = {}
    for i, name in enumerate(STATE_NAMES):
        strengths = [float(s[i]) for s in by_step]
        seen = [k for k, s in enumerate(strengths) if s > 1.0 / OBSERVABLE]
        states[name] = {
            "step": segments[seen[0]]["step"] if seen else None,
            "strength": float(f"{strengths[-1]:.4g}") if strengths else 1.0,
            "by_step": [float(f"{s:.3g}") for s in strengths],
        }
    return {"segments": segments, "states": states}


def _stacked(R: FloatArray, rows: FloatArray) -> FloatArray:
    """The triangular factor of all rows so far, shape (39, 39)."""
    return np.asarray(np.linalg.qr(np.vstack([R, rows]), mode="r"))


def _piece(
    context: SolveContext, point: FloatArray, C: FloatArray, omega: FloatArray, T: float
) -> tuple[FloatArray, FloatArray]:
    """Rows H (F T)^k / k! of one piece, shape (3 POWERS, 39), and its transition exp(F T), shape (39, 39)."""
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
