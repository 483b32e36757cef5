"""Residuals of a stage by rest and move, and the location of an excess over their expected variance.

For each rest and move, the innovations during it are tested, and the constant channel error that explains them best is
estimated. An excess is located in one rest or move, in all of one kind, or in the whole stage.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from calstation.estimation.common.context import Posterior
from calstation.estimation.common.residuals import RestResiduals
from calstation.estimation.common.stage import StageData
from calstation.messages import Text
from calstation.physics import CHANNELS, JOINTS, FloatArray, IntArray

#: Smallest rotation of a move, rad; earth rate is 0.25° per minute.
SMALLEST_MOVE = np.deg2rad(1.0)
#: Number of sigmas above which a rest or move is notable, and above which its data contradict the model.
NOTABLE, EXCESSIVE = 4.0, 5.0
#: Smallest share of the excess that is attributed to rests or moves.
_MIN_SHARE = 0.5
#: Smallest ratio of the excess per component in some rests or moves to that elsewhere for scatter to be attributed to
#: them.
_MIN_DENSITY_RATIO = 2.0
#: Fraction of the share that a constant error may leave unexplained; if it leaves more, the excess is scatter.
_SCATTER = 0.15
#: Smallest ratio of the share of one rest or move to that of any other for the excess to be attributed to it.
_MIN_LEAD = 1.5
#: For innovations that are not independent, rests or moves within this many sigmas of the worst are reported with it.
_WITHIN_SIGMAS = 1.0
#: Location of an excess: one rest or move, those with a common axis, all rests, all moves, or the whole stage.
Location = Literal["rest", "move", "rests_up", "moves_about", "rests", "moves", "stage"]
#: Locations of those with a common axis and of all of them, by kind.
_LOCATIONS: dict[str, tuple[Location, Location]] = {"rest": ("rests_up", "rests"), "move": ("moves_about", "moves")}


@dataclass(frozen=True)
class LocalScores:
    """Score tests for constant errors of the channels, gyro x y z and accel x y z, each during one of k spans.

    An error θ decreases the sum of the squared innovations by 2 θᵀ score − θᵀ information θ.
    """

    score: FloatArray  #: SI, shape (6 k,).
    information: FloatArray  #: SI, shape (6 k, 6 k).
    shift: FloatArray  #: Shift of the 30 parameters, estimate minus truth, per unit of each error, SI, shape (30, 6 k).
    span_score: FloatArray  #: `score` from the innovations of the same span only, SI, shape (k, 6).
    span_information: FloatArray  #: `information` from the innovations of the same span only, SI, shape (k, 6, 6).

    def common(self, spans: Sequence[int], signs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return score, shape (6,), and information, shape (6, 6), of errors common to n spans, with n `signs`."""
        indices = np.asarray(spans)
        blocks = self.information.reshape(len(self.span_score), 6, -1, 6)[indices][:, :, indices]
        score = np.asarray(signs @ self.score.reshape(-1, 6)[indices])
        return score, np.asarray(np.einsum("a,aibj,b->ij", signs, blocks, signs))

    def explained(self, spans: Sequence[int], signs: FloatArray) -> float:
        """Return the decrease of the sum of squares by common errors, minus the decrease expected by chance."""
        score, information = self.common(spans, signs)
        return float(score @ np.linalg.pinv(information, hermitian=True) @ score) - len(score)

    def span_explained(self, span: int) -> float:
        """Return the decrease of the sum of squares of a span's innovations by errors during the span."""
        score, information = self.common([span], np.ones(1))
        error = np.linalg.pinv(information, hermitian=True) @ score
        return float(2.0 * error @ self.span_score[span] - error @ self.span_information[span] @ error)

    def single(self, spans: Sequence[int], signs: FloatArray) -> tuple[int, float, float]:
        """Return the channel whose common error, estimated alone, is most significant, the error and its sigma, SI."""
        score, information = self.common(spans, signs)
        diagonal = np.maximum(np.diag(information), np.finfo(float).tiny)
        channel = int(np.argmax(np.abs(score) / np.sqrt(diagonal)))
        return channel, float(score[channel] / diagonal[channel]), float(1.0 / np.sqrt(diagonal[channel]))


#: Function that returns the score tests for spans (start, stop) of a stage's samples, in the same order.
ScoreFunction = Callable[[Sequence[tuple[int, int]]], LocalScores]


@dataclass(frozen=True)
class PositionResidual:
    """Residuals of one rest or one move of a stage, in sigmas; NaN without observations."""

    kind: Literal["rest", "move"]
    number: int  #: Number of the rest, or of the move, within the stage, from 1.
    step: int  #: Step number at the end of the rest or move, as in `SampleBlock`.
    first_seq: int
    last_seq: int
    duration: float  #: s
    #: For a rest, the axis that points up, see `upward_axis`; for a move, ``outer``, ``inner`` or ``outer+inner``, or
    #: the body axis (``x``) without encoders.
    axis: str
    turned: float  #: Rotation of a move about its axis, rad; 0 at rest.
    body: str  #: Signed body axis of a move, such as "-x"; "" at rest.
    angles: tuple[float, float]  #: Outer and inner encoder angle at the end, rad, NaN without encoders.
    freedom: int  #: Number of innovation components.
    total: float  #: Sum of the squares of the innovation components.
    excess: float  #: `total` as a standard normal deviate of the same probability.
    component: int  #: Component with the largest mean: 0, 1 or 2.
    mean: float  #: Mean of that component, in sigmas of the mean.
    channel: int | None  #: Channel with the most significant error here, 0 to 5 (gyro x y z, accel x y z).
    error: float  #: Constant error of that channel that best fits all innovations, rad/s or m/s².
    error_sigma: float  #: Sigma of `error`.
    force: float  #: Magnitude of the specific force minus gravity.
    vertical_rate: float  #: Rate along up minus the vertical earth rate.
    horizontal_rate: float  #: Rate perpendicular to up minus the horizontal earth rate.

    @property
    def worst(self) -> float:
        """Largest test statistic of this rest or move, in sigmas; the constant error is preferred to the mean."""
        local = self.mean if self.channel is None else self.error / self.error_sigma
        return float(np.fmax(self.excess, abs(local)))

    @property
    def state(self) -> Literal["good", "caution", "bad"]:
        """Verdict on `worst`."""
        return "bad" if self.worst > EXCESSIVE else "caution" if self.worst > NOTABLE else "good"

    @property
    def error_unit(self) -> str:
        """Unit of `error`, SI."""
        return "rad/s" if self.channel is not None and self.channel < 3 else "m/s²"

    @property
    def channel_name(self) -> str:
        """Name of `channel`; "" if there is none."""
        return "" if self.channel is None else CHANNELS[self.channel]

    @property
    def component_name(self) -> str:
        """Name of `component`: an axis of ENU for velocities of the 39-state filter, otherwise a body axis."""
        return "xyz"[self.component] if self.channel is None else ("east", "north", "up")[self.component]

    @property
    def text(self) -> Text:
        """Text that identifies the rest or move by its number, axis and angles."""
        outer, inner, turned = np.rad2deg([*self.angles, self.turned]).tolist()
        code = f"residual.{self.kind}" if np.isnan(outer) else f"residual.{self.kind}_at"
        axis = self.axis if self.kind == "rest" else self.axis.split("+")
        return Text(code, {"number": self.number, "axis": axis, "outer": outer, "inner": inner, "turned": turned})

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON values; null for NaN."""
        row = {key: None if value != value else value for key, value in vars(self).items()}
        angles = [None if value != value else value for value in self.angles]
        return {**row, "angles": angles, "channel": None if self.channel is None else CHANNELS[self.channel]}


@dataclass(frozen=True)
class StageResiduals:
    """Residuals of a stage by rest and move, in chronological order."""

    rows: tuple[PositionResidual, ...] = ()
    scores: LocalScores | None = None  #: Score tests of the rows; None without the 39-state filter.


def position_residuals(
    data: StageData,
    rests: RestResiduals,
    posterior: Posterior,
    seq: IntArray,
    normalised: FloatArray,
    *,
    white: bool,
    score: ScoreFunction | None,
) -> StageResiduals:
    """Aggregate the innovations of a stage by rest and move.

    Parameters
    ----------
    rests : residuals of the stage's rests, with the parameters `posterior`
    seq, normalised : as in `Innovations`
    white : whether the components are independent; otherwise `excess` is the largest component instead of the sum
    score : function that computes the score tests; None without the 39-state filter
    """
    spans = _spans(data, rests, posterior)
    scores = None if score is None else score([(start, stop) for start, stop, _ in spans])
    stops = np.array([data.seq[stop - 1] for _, stop, _ in spans], dtype=np.int64)
    span_of = np.searchsorted(stops, seq)
    rows: list[PositionResidual] = []
    for index, (start, stop, rest) in enumerate(spans):
        z = normalised[span_of == index]
        count = np.sum(np.isfinite(z), axis=0)
        means = np.nansum(z, axis=0) / np.sqrt(np.maximum(count, 1))
        freedom, total = int(count.sum()), float(np.nansum(z**2))
        component = int(np.argmax(np.abs(means)))
        error: tuple[int | None, float, float] = (None, np.nan, np.nan)
        if scores is not None:
            error = scores.single([index], np.ones(1))
        kind: Literal["rest", "move"]
        if rest is None:
            kind, residual = "move", (np.nan, np.nan, np.nan)
            axis, angle, body = _rotation(data, start, stop, posterior)
        else:
            kind, residual = "rest", rests.in_sigma(rest)
            axis, angle, body = rests.axis(rest), 0.0, ""
        polled = np.flatnonzero(np.isfinite(data.angles[start:stop]).all(axis=1))
        outer, inner = data.angles[start + polled[-1]].tolist() if len(polled) else (np.nan, np.nan)
        excess = np.nan
        if freedom:
            excess = normal_deviate(total, freedom) if white else float(np.abs(means).max())
        rows.append(
            PositionResidual(
                kind,
                1 + sum(row.kind == kind for row in rows),
                int(data.step[stop - 1]),
                int(data.seq[start]),
                int(data.seq[stop - 1]),
                (stop - start) * data.dt,
                axis,
                angle,
                body,
                (outer, inner),
                freedom,
                total,
                excess,
                component,
                float(means[component]) if freedom else np.nan,
                *error,
                *residual,
            )
        )
    return StageResiduals(tuple(rows), scores)


def normal_deviate(total: float, freedom: int) -> float:
    """Return the standard normal deviate with the same probability as a χ² of `total`.

    E. B. Wilson, M. M. Hilferty, *The distribution of chi-square*, PNAS 17(12), 1931.
    """
    variance = 2.0 / (9.0 * freedom)
    return float((np.cbrt(total / freedom) - (1.0 - variance)) / np.sqrt(variance))


def _spans(data: StageData, rests: RestResiduals, posterior: Posterior) -> list[tuple[int, int, int | None]]:
    """Divide the samples between gaps into rests and moves: (start, stop, index of the rest, or None for a move).

    Samples between two rests without a rotation, for example while the table creeps, belong to the preceding span.
    """
    begin = np.searchsorted(data.seq, rests.first_seq)
    end = np.searchsorted(data.seq, rests.last_seq) + 1
    changed = np.flatnonzero(np.diff(data.step)) + 1

    def still(start: int, stop: int) -> bool:
        return bool(abs(_rotation(data, start, stop, posterior)[1]) < SMALLEST_MOVE)

    spans: list[tuple[int, int, int | None]] = []
    for first, last in data.segments:
        inside = np.flatnonzero((begin >= first) & (end <= last))
        cuts = np.unique([first, last, *begin[inside], *end[inside], *changed[(changed > first) & (changed < last)]])
        segment_spans: list[tuple[int, int, int | None]] = []
        for start, stop in pairwise(cuts.tolist()):
            rest = next((int(k) for k in inside if begin[k] <= start and stop <= end[k]), None)
            if segment_spans:
                last_start, last_stop, last_rest = segment_spans[-1]
                if rest is None and still(start, stop):
                    segment_spans[-1] = (last_start, stop, last_rest)
                    continue
                if rest is not None and (last_rest == rest or (last_rest is None and still(last_start, last_stop))):
                    segment_spans[-1] = (last_start, stop, rest)
                    continue
            segment_spans.append((start, stop, rest))
        spans += segment_spans
    return spans


def _rotation(data: StageData, start: int, stop: int, posterior: Posterior) -> tuple[str, float, str]:
    """Return the axis, the angle, rad, and the signed body axis of a rotation, see `PositionResidual`."""
    rotation = (data.gyro[start:stop] - posterior.gyro_bias[0]).sum(axis=0) * data.dt
    k = int(np.argmax(np.abs(rotation)))
    signed = ("-" if rotation[k] < 0.0 else "+") + "xyz"[k]
    polled = np.flatnonzero(np.isfinite(data.angles[start:stop]).all(axis=1))
    if len(polled) > 1:
        angles = data.angles[start + polled[-1]] - data.angles[start + polled[0]]
        names = [name for name, angle in zip(JOINTS, angles, strict=True) if abs(angle) >= SMALLEST_MOVE]
        if names:
            return "+".join(names), float(angles[np.argmax(np.abs(angles))]), signed
    return "xyz"[k], float(rotation[k]), signed


@dataclass(frozen=True)
class Concentration:
    """Rests and moves that contain most of the excess, and whether it is a constant error or scatter."""

    location: Location
    rows: tuple[int, ...]  #: Indices of the rests and moves, the worst first.
    share: float  #: Share of the stage's excess of squared innovations.
    signs: FloatArray | None = None  #: Sign by row of a common channel error; None for scatter.
    axis: str = ""  #: Axis that the rests or moves have in common.


def concentration(residuals: StageResiduals, *, white: bool) -> Concentration:
    """Find the fewest rests or moves of a stage that contain most of its excess.

    The excess is either scatter during these rests or moves, or the result of a constant channel error during them,
    whose effect the filter spreads over all later ones. If the innovations are not `white`, the rests and moves with
    the largest innovations are returned.
    """
    rows = residuals.rows
    if not white:
        worst = np.array([np.nan_to_num(row.excess) for row in rows])
        indices = _worst_first(np.flatnonzero(worst > worst.max() - _WITHIN_SIGMAS), rows)
        return Concentration(rows[indices[0]].kind if 2 * len(indices) < len(rows) else "stage", indices, 1.0)
    best, *others = sorted(_single(residuals), key=lambda c: -c.share)
    if best.share > _MIN_SHARE and best.share > _MIN_LEAD * max((c.share for c in others), default=0.0):
        return best
    for candidates in (_common(residuals), _scattered(rows, by_axis=True), _scattered(rows)):
        largest = max(candidates, key=lambda c: c.share, default=None)
        if largest is not None and largest.share > _MIN_SHARE:
            return largest
    return Concentration("stage", _worst_first(range(len(rows)), rows), 1.0)


def _excess(rows: Sequence[PositionResidual]) -> float:
    return sum(row.total - row.freedom for row in rows)


def _single(residuals: StageResiduals) -> Iterator[Concentration]:
    """Yield every rest and move with the excess due to a constant error of the channels during it plus its scatter."""
    total, scores = _excess(residuals.rows), residuals.scores
    for k, row in enumerate(residuals.rows):
        remaining = _excess([row])
        shift = 0.0
        if scores is not None:
            remaining -= scores.span_explained(k)
            shift = max(scores.explained([k], np.ones(1)), 0.0)
        share = (shift + max(remaining, 0.0)) / total
        yield Concentration(row.kind, (k,), share, np.ones(1) if remaining < _SCATTER * share * total else None)


def _common(residuals: StageResiduals) -> Iterator[Concentration]:
    """Yield common errors of the rests with the same axis up, and of the moves about the same joint or body axis."""
    rows, scores = residuals.rows, residuals.scores
    if scores is None:
        return
    total = _excess(rows)
    sets: dict[tuple[Location, str], list[int]] = {}
    for k, row in enumerate(rows):
        for axis in dict.fromkeys((row.axis, row.body[1:] or row.axis)):
            sets.setdefault((_LOCATIONS[row.kind][0], axis), []).append(k)
    for (location, axis), members in sets.items():
        if len(members) > 1:
            ordered = _worst_first(members, rows)
            signs = np.array([-1.0 if rows[k].body.startswith("-") else 1.0 for k in ordered])
            for sign in (np.ones(len(ordered)), signs):
                share = scores.explained(ordered, sign) / total
                yield Concentration(location, ordered, share, sign, axis)


def _scattered(rows: Sequence[PositionResidual], *, by_axis: bool = False) -> Iterator[Concentration]:
    """Yield the scatter of the rests with the same axis up and of the moves about a joint, or of all rests or moves."""
    total, freedom = _excess(rows), sum(row.freedom for row in rows)
    sets: dict[tuple[Location, str], list[int]] = {}
    for k, row in enumerate(rows):
        with_axis, all_rows = _LOCATIONS[row.kind]
        sets.setdefault((with_axis, row.axis) if by_axis else (all_rows, ""), []).append(k)
    for (location, axis), members in sets.items():
        inside, share = _excess([rows[k] for k in members]), sum(rows[k].freedom for k in members) / freedom
        if inside * (1.0 - share) > _MIN_DENSITY_RATIO * (total - inside) * share:
            yield Concentration(location, _worst_first(members, rows), inside / total, axis=axis)


def _worst_first(indices: Sequence[int] | np.ndarray, rows: Sequence[PositionResidual]) -> tuple[int, ...]:
    return tuple(sorted((int(k) for k in indices), key=lambda k: -np.nan_to_num(rows[k].worst)))
