"""Response of the navigation filter to errors of its prior, to effects outside the model, and to errors in spans."""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import solve_triangular

from calstation.estimation.common import (
    SHORTEST_REST,
    LocalScores,
    SolveContext,
    StageData,
    Start,
    group_means,
    mean_angles,
)
from calstation.estimation.effects import Sensitivity, StageEffects, last_turns, mean_regressors, velocity_errors
from calstation.estimation.navigation.group_update import Updates
from calstation.estimation.navigation.navigation_pass import GROUP_TIME, History
from calstation.estimation.navigation.relinearise import REST_RATE, NavigationResult
from calstation.estimation.navigation.small_matrices import add_product, forward, subtract_transposed_product
from calstation.estimation.navigation.velocity_group import BIAS, OBSERVED
from calstation.physics import (
    COUNT,
    NAVIGATION,
    PARAMETER_STATES,
    STATES,
    UP,
    BoolArray,
    FloatArray,
    IntArray,
    Motion,
    OuterTurn,
    axis_rotation,
    compensate,
    compensation,
    group_matrix,
    group_vector,
    kernel,
    rotation_rate,
)

#: Number of observation intervals over which slopes are smoothed.
SMOOTHED = 5
#: Smallest determinant of the mean attitude of a group, 1 without rotation and 0.4 for a rotation by 180°.
MIN_DETERMINANT = 0.4
#: Number of groups of observations whose score tests are added together.
_BATCH = 100


def result_sensitivity(
    result: NavigationResult, data: StageData, context: SolveContext, estimated: BoolArray
) -> Sensitivity:
    """Return the sensitivity of a solution to prior errors and to effects, from the updates of its last pass.

    An effect of the sensors is an additional sensor error, averaged over each group of observations. An effect of the
    table is a velocity that is missing in every observation. The effect of a parameter change is computed from the
    update in which it begins.

    Parameters
    ----------
    result : solution with the updates of its last pass
    data : samples of the stage
    context : IMU, table and site
    estimated : whether each parameter is estimated, shape (30,)
    """
    effects = StageEffects(float(data.time[0]), len(data) * data.dt)
    motion = motion_between_observations(result.history, data, result.starts, context, result.point)
    updates = result.updates
    counts = np.repeat([u.innovation.shape[1] // 3 for u in updates], [len(u.innovation) for u in updates])
    regressors, terms = mean_regressors(motion, effects.candidates, counts[counts > 0])
    velocity, of_table = velocity_errors(motion, effects.candidates)
    columns = COUNT + sum(len(c.components) for c in effects.candidates)
    begin = np.repeat(
        [c.begin for c in effects.parameter_changes], [len(c.components) for c in effects.parameter_changes]
    )
    ends = motion.time[np.cumsum(counts) - 1]
    error = np.zeros((updates[0].H.shape[2], columns - len(begin)))
    error[PARAMETER_STATES, :COUNT] = np.eye(COUNT)
    score, information = np.zeros(columns), np.zeros((columns, columns))
    group = observed = 0
    for update in updates:
        if not update.transition.size:
            error[NAVIGATION] = 0.0
            error[STATES:] *= update.decay[:, None]
            error -= update.gain[0].T @ solve_triangular(update.root[0], update.H[0] @ error, lower=True)
            continue
        first, group = group, group + len(update.H)
        before, observed = observed, observed + update.innovation.size // 3
        missing = velocity[before:observed].reshape(*update.innovation.shape, len(of_table))
        active = columns - len(begin) + int(np.searchsorted(begin, ends[group - 1], side="right"))
        error = np.hstack([error, np.zeros((len(error), active - error.shape[1]))])
        white = np.empty((update.innovation.size, active))
        active_terms = terms[terms[:, 1] < active - COUNT]
        _propagate_errors(update, regressors[first:group], active_terms, missing, of_table, error, white)
        information[:active, :active] += white.T @ white
        score[:active] += white.T @ update.innovation.ravel()
    error = np.hstack([error, np.zeros((len(error), columns - error.shape[1]))])
    return effects.sensitivity(score, information, error[PARAMETER_STATES], estimated)


@kernel
def _propagate_errors(
    update: Updates,
    regressors: FloatArray,
    terms: IntArray,
    missing: FloatArray,
    of_table: IntArray,
    error: FloatArray,
    white: FloatArray,
) -> None:
    """Write the effect of the errors on the normalised innovations of g groups to `white`, shape (g r, columns).

    Parameters
    ----------
    update : the groups
    regressors, terms : result of `mean_regressors` for these groups
    missing : velocities missing in the observations, per unit of size, shape (g, r, k)
    of_table : component of each of these sizes, shape (k,)
    error : state errors, shape (n, columns); updated in place, except for δp, which affects nothing
    white : output
    """
    groups, rows, _ = update.H.shape
    size, columns = error.shape
    predicted, bias_errors = np.empty((OBSERVED, columns)), np.zeros((len(BIAS), columns - COUNT))
    for g in range(groups):
        for k in range(len(terms)):
            bias_errors[terms[k, 0], terms[k, 1]] = regressors[g, terms[k, 2]]
        F, H, response = update.transition[g], update.H[g], white[g * rows : (g + 1) * rows]
        predicted[:] = 0.0
        add_product(F[:OBSERVED], error, predicted)
        error[:OBSERVED] = predicted
        for i in range(STATES, size):
            for j in range(columns):
                error[i, j] *= update.decay[i - STATES]
        _add_bias(F[:OBSERVED], bias_errors, error)
        response[:] = 0.0
        add_product(H, error, response)
        _add_bias(H, bias_errors, response)
        for k in range(len(of_table)):
            for i in range(rows):
                response[i, COUNT + of_table[k]] -= missing[g, i, k]
        forward(update.root[g], response)
        subtract_transposed_product(update.gain[g], response, error)


@kernel
def _add_bias(A: FloatArray, bias_errors: FloatArray, out: FloatArray) -> None:
    """Add the effect of the bias errors through A, shape (m, n), to the first m rows of `out`."""
    for i in range(len(A)):
        for k in range(len(BIAS)):
            t = A[i, BIAS[k]]
            if t != 0.0:
                for j in range(out.shape[1] - COUNT):
                    out[i, COUNT + j] += t * bias_errors[k, j]


def local_scores(spans: Sequence[tuple[int, int]], *, updates: Sequence[Updates], index: IntArray) -> LocalScores:
    """Return the score tests for errors during spans of a stage's samples, in the same order.

    A channel error during a span acts like an additional bias. Its effect on the innovations follows from the
    transitions and gains of the last pass (P. de Jong, J. Penzer, *Diagnosing shocks in time series*, JASA 93(442),
    1998).

    Parameters
    ----------
    spans : indices (start, stop) of the samples of each span
    updates : updates of the last pass
    index : number of samples before each of the n observations of that pass, shape (n,)
    """
    stops = np.array([stop for _, stop in spans])
    size, width = updates[0].H.shape[2], 6 * len(spans)
    effect = np.zeros((size, width))  # error of the states due to the channel errors
    score, information = np.zeros(width), np.zeros((width, width))
    span_score, span_information = np.zeros((len(spans), 6)), np.zeros((len(spans), 6, 6))
    batch: list[FloatArray] = []  # effect on the innovations of the last groups, and these innovations
    observed = 0
    for update in updates:
        if not update.transition.size:
            effect[NAVIGATION] = 0.0
            effect[STATES:] *= update.decay[:, None]
            effect -= update.gain[0].T @ np.linalg.solve(update.root[0], update.H[0] @ effect)
            continue
        rows_of_groups = zip(update.transition, update.H, update.root, update.gain, update.innovation, strict=True)
        for transition, H, root, gain, innovation in rows_of_groups:
            count = len(innovation) // 3
            span = min(int(np.searchsorted(stops, index[observed + count // 2])), len(spans) - 1)
            observed += count
            active, current = 6 * (span + 1), slice(6 * span, 6 * span + 6)
            predicted = transition @ effect[:, :active]
            predicted[:, current] += transition[:, BIAS]
            effect[NAVIGATION, :active] = predicted
            effect[STATES:] *= update.decay[:, None]
            white = np.zeros((len(H), width + 1))
            white[:, :active] = H @ effect[:, :active]
            white[:, current] += H[:, BIAS]
            white = np.linalg.inv(root) @ white
            white[:, -1] = innovation
            effect[:, :active] -= gain.T @ white[:, :active]
            span_score[span] += white[:, current].T @ white[:, -1]
            span_information[span] += white[:, current].T @ white[:, current]
            batch.append(white)
            if len(batch) == _BATCH or observed == len(index):
                rows = np.concatenate(batch)
                score += rows[:, :-1].T @ rows[:, -1]
                information += rows[:, :-1].T @ rows[:, :-1]
                batch.clear()
    return LocalScores(score, information, -effect[PARAMETER_STATES], span_score, span_information)


def motion_between_observations(
    history: History, data: StageData, starts: Sequence[Start], context: SolveContext, point: FloatArray
) -> Motion:
    """Return the motion in every interval between observations.

    The force is computed from gravity and the lever arm, because the measured force contains the vibration of the base,
    which is the noise of the observations. At rest the rate equals earth rate, and slopes are smoothed, because gyro
    noise also enters the observations through the lever arm.

    Parameters
    ----------
    history : history of the pass
    data : samples of the stage
    starts : starts of the segments
    context : IMU, table and site
    point : parameters about which the pass was linearised, SI, shape (30,)
    """
    earth, gravity = rotation_rate(context.site.latitude), context.site.local_gravity
    constants, lever = compensation(point), group_vector(point, "outer_lever")
    parts: list[tuple[FloatArray, ...]] = []
    turns: list[tuple[FloatArray, ...] | None] = []
    for start in starts:
        inside = (history.index > start.begin) & (history.index <= start.end)
        index, C, rate = history.index[inside], history.attitude[inside], history.rate[inside]
        stride = int(index[0]) - start.begin
        T = stride * data.dt
        stop = start.begin + stride * len(index)
        gyro = data.gyro[start.begin : min(stop + 1, start.end)]
        mean = group_means(gyro[: stride * len(index)], stride)
        omega, _ = compensate(constants, mean, np.zeros_like(mean))
        samples, _ = compensate(constants, gyro, np.zeros_like(gyro))
        products = np.cross(samples, np.concatenate([samples[1:], samples[-1:]])) / data.dt
        coning = group_means(products[: stride * len(index)], stride)
        rate_nb = rate - np.einsum("nji,j->ni", C, earth)
        arm = np.einsum("nij,nj->ni", C, np.cross(rate_nb, lever))
        acceleration = np.diff(arm, axis=0, prepend=arm[:1]) / T + gravity * UP
        before = np.concatenate([C[:1], C[:-1]])
        force = 0.5 * np.einsum("nji,nj->ni", C + before, acceleration)
        angle = np.linalg.norm(np.einsum("nij,nik->njk", before, C) - np.eye(3), axis=(1, 2)) / np.sqrt(2.0)
        still = angle < REST_RATE * T
        omega[still] = np.einsum("nji,j->ni", C[still], earth)
        several = len(index) > 1
        slopes = [np.gradient(_smooth(x), T, axis=0) if several else np.zeros_like(x) for x in (omega, force)]
        for slope in (*slopes, coning):
            slope[still] = 0.0
        coning = _constant_in_groups(coning, 0.5 * (C + before), max(round(GROUP_TIME / T), 1))
        time = (data.seq[index - 1] - data.seq[0]) * data.dt
        parts.append((omega, force, *slopes, time, coning))
        turns.append(_outer_turn(start, C, T, data, context))
    known = [turn for turn in turns if turn is not None]
    outer = None
    if len(known) == len(turns):
        outer = OuterTurn(*(np.concatenate(column) for column in zip(*known, strict=True)))
    rate, specific_force, turning, jerk, time, coning = (np.concatenate(c) for c in zip(*parts, strict=True))
    axes = np.eye(3) + group_matrix(point, "gyro_scale", "gyro_misalign")
    senses = last_turns(data, point, context.initial_turn_senses, starts[0].begin)  # a stage may begin with a move
    return Motion(rate, specific_force, turning, jerk, time, outer, np.array(senses), coning, axes)


def _outer_turn(
    start: Start, attitude: FloatArray, duration: float, data: StageData, context: SolveContext
) -> tuple[FloatArray, ...] | None:
    """Return the fields of `OuterTurn` for the intervals of a segment, the first of which is at rest.

    The outer axis is computed from the azimuth of the table or, if that is unknown, from the attitude and the angles at
    the start; the result is None if there are no angles either. `attitude` is C_bn at the ends of the intervals, shape
    (n, 3, 3), and `duration` is the duration of an interval, s.
    """
    geometry, azimuth = context.table.geometry, context.site.azimuth
    if azimuth is not None:
        home = axis_rotation(UP, -azimuth)
    else:
        angles = mean_angles(data, start.begin, start.begin + max(round(SHORTEST_REST / data.dt), 1))
        if angles is None:
            return None
        home = attitude[0] @ geometry.body_to_home(*angles).T
    axis = np.broadcast_to(home @ np.array(geometry.outer_axis), (len(attitude), 3))
    inner = attitude @ (np.array(geometry.orientation).T @ np.array(geometry.inner_axis))
    return axis, np.concatenate([inner[:1], inner[:-1]]), inner, np.full(len(inner), duration)


def _constant_in_groups(errors: FloatArray, attitude: FloatArray, width: int) -> FloatArray:
    """Return errors in b, constant in each group of `width` intervals, with the same sums in n, shape (n, 3).

    `attitude` is C_bn in the middle of each interval, shape (n, 3, 3). The effect of errors that change while the unit
    rotates differs from that of their mean. If a unit rotates too far within a group, the mean in b is used.
    """
    first = np.arange(0, len(errors), width)
    counts = np.diff(first, append=len(errors))
    total = np.add.reduceat(attitude, first, axis=0) / counts[:, None, None]
    mean = np.add.reduceat(errors, first, axis=0) / counts[:, None]
    in_n = np.add.reduceat(np.einsum("nij,nj->ni", attitude, errors), first, axis=0) / counts[:, None]
    near = np.linalg.det(total) > MIN_DETERMINANT
    mean[near] = np.linalg.solve(total[near], in_n[near, :, None])[:, :, 0]
    return np.repeat(mean, counts, axis=0)


def _smooth(values: FloatArray) -> FloatArray:
    """Return moving means over `SMOOTHED` rows, shape (n, 3)."""
    padded = np.pad(values, ((SMOOTHED // 2, SMOOTHED // 2), (0, 0)), mode="edge")
    return np.asarray(sliding_window_view(padded, SMOOTHED, axis=0).mean(axis=2))
