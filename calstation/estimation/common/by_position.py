"""Residuals of a stage per rest and move: the innovations during it, and a constant channel error confined to it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from calstation.estimation.common.context import Posterior
from calstation.estimation.common.residuals import RestResiduals
from calstation.estimation.common.stage import StageData
from calstation.messages import Text
from calstation.physics import CHANNELS, JOINTS, FloatArray, IntArray

#: A rotation smaller than this, rad, does not count as a move; earth rate is 0.25° per minute.
SMALLEST_MOVE = np.deg2rad(1.0)
#: Sigmas above which a rest or move is notable, and above which its data contradict the model.
NOTABLE, EXCESSIVE = 4.0, 5.0


@dataclass(frozen=True)
class LocalScores:
    """Score tests of constant errors of the channels, gyro x y z and accel x y z, each during one of k spans.

    An error θ decreases the sum of the squared innovations by 2 θᵀ score − θᵀ information θ.
    """

    score: FloatArray  #: SI, shape (6 k,).
    information: FloatArray  #: SI, shape (6 k, 6 k).
    shift: FloatArray  #: Shift of the 30 parameters per unit of each error, SI, shape (30, 6 k).
    own_score: FloatArray  #: `score` from the innovations of the same span alone, SI, shape (k, 6).
    own_information: FloatArray  #: `information` from the innovations of the same span alone, SI, shape (k, 6, 6).

    def common(self, spans: Sequence[int], signs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return score, shape (6,), and information, shape (6, 6), of errors that are common to n spans.

        They change their signs with `signs` of the spans, shape (n,).
        """
        chosen = np.asarray(spans)
        blocks = self.information.reshape(len(self.own_score), 6, -1, 6)[chosen][:, :, chosen]
        score = np.asarray(signs @ self.score.reshape(-1, 6)[chosen])
        return score, np.asarray(np.einsum("a,aibj,b->ij", signs, blocks, signs))

    def explained(self, spans: Sequence[int], signs: FloatArray) -> float:
        """Return how much more than by chance common errors decrease the sum of squares, see `common`."""
        score, information = self.common(spans, signs)
        return float(score @ np.linalg.pinv(information, hermitian=True) @ score) - len(score)

    def own_explained(self, span: int) -> float:
        """Return how much errors during a span decrease the sum of squares of the innovations of this span."""
        score, information = self.common([span], np.ones(1))
        error = np.linalg.pinv(information, hermitian=True) @ score
        return float(2.0 * error @ self.own_score[span] - error @ self.own_information[span] @ error)

    def single(self, spans: Sequence[int], signs: FloatArray) -> tuple[int, float, float]:
        """Return the channel whose own common error is most significant, with that error and its sigma, SI."""
        score, information = self.common(spans, signs)
        one = np.maximum(np.diag(information), np.finfo(float).tiny)
        channel = int(np.argmax(np.abs(score) / np.sqrt(one)))
        return channel, float(score[channel] / one[channel]), float(1.0 / np.sqrt(one[channel]))


#: Function that returns the score tests for spans (start, stop) of a stage's samples, in the order given.
ScoreFunction = Callable[[StageData, Sequence[tuple[int, int]]], LocalScores]


@dataclass(frozen=True)
class PositionResidual:
    """Residuals of one rest or one move of a stage, in sigmas; NaN where there is nothing to test."""

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
    total: float  #: Sum of their squares.
    #: `total` as a standard normal deviate that is exceeded with the same probability.
    excess: float
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
        """Largest test statistic of this rest or move, sigmas: from an error confined to it, if possible."""
        local = self.mean if self.channel is None else self.error / self.error_sigma
        return float(np.fmax(self.excess, abs(local)))

    @property
    def state(self) -> Literal["good", "caution", "bad"]:
        """Verdict about `worst`."""
        return "bad" if self.worst > EXCESSIVE else "caution" if self.worst > NOTABLE else "good"

    @property
    def error_unit(self) -> str:
        """SI unit of `error`."""
        return "rad/s" if self.channel is not None and self.channel < 3 else "m/s²"

    @property
    def channel_name(self) -> str:
        """Name of `channel`, "" if there is none."""
        return "" if self.channel is None else CHANNELS[self.channel]

    @property
    def component_name(self) -> str:
        """Name of `component`: of the velocity in the level frame, or the body axis in a stage without the filter."""
        return "xyz"[self.component] if self.channel is None else ("east", "north", "up")[self.component]

    @property
    def text(self) -> Text:
        """Name of the rest or move: its number, axis and angles."""
        outer, inner, turned = np.rad2deg([*self.angles, self.turned]).tolist()
        code = f"residual.{self.kind}" if np.isnan(outer) else f"residual.{self.kind}_at"
        return Text(code, {"number": self.number, **self.axis_values, "outer": outer, "inner": inner, "turned": turned})

    @property
    def axis_values(self) -> dict[str, Any]:
        """Value `axis` of messages."""
        return {"axis": self.axis if self.kind == "rest" else self.axis.split("+")}

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON values; null for NaN."""
        row = {key: None if value != value else value for key, value in vars(self).items()}
        angles = [None if value != value else value for value in self.angles]
        return {**row, "angles": angles, "channel": None if self.channel is None else CHANNELS[self.channel]}


@dataclass(frozen=True)
class StageResiduals:
    """Residuals of a stage per rest and move, in chronological order."""

    rows: tuple[PositionResidual, ...] = ()
    scores: LocalScores | None = None  #: Score tests of the rows; None for a stage without the 39-state filter.


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
    """Aggregate the innovations of a stage per rest and move.

    Parameters
    ----------
    rests : residuals of the stage's rests, with the parameters `posterior`
    seq, normalised : as in `Innovations`
    white : whether the components are independent; if not, `excess` is the largest component instead of their sum
    score : computes the score tests; None for a stage without the 39-state filter
    """
    spans = _spans(data, rests, posterior)
    scores = None if score is None else score(data, [(start, stop) for start, stop, _ in spans])
    stops = np.array([data.seq[stop - 1] for _, stop, _ in spans], dtype=np.int64)
    owner = np.searchsorted(stops, seq)
    rows: list[PositionResidual] = []
    for index, (start, stop, rest) in enumerate(spans):
        z = normalised[owner == index]
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
            axis, turned, body = _rotation(data, start, stop, posterior)
        else:
            kind, residual = "rest", rests.in_sigma(rest)
            axis, turned, body = rests.axis(rest), 0.0, ""
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
                turned,
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
    """Return the standard normal deviate that is as improbable as a χ² of `total`.

    E. B. Wilson, M. M. Hilferty, *The distribution of chi-square*, PNAS 17(12), 1931.
    """
    variance = 2.0 / (9.0 * freedom)
    return float((np.cbrt(total / freedom) - (1.0 - variance)) / np.sqrt(variance))


def _spans(data: StageData, rests: RestResiduals, posterior: Posterior) -> list[tuple[int, int, int | None]]:
    """Divide the samples into rests and moves: (start, stop, index of the rest or None), without the gaps.

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
        here: list[tuple[int, int, int | None]] = []
        for start, stop in pairwise(cuts.tolist()):
            rest = next((int(k) for k in inside if begin[k] <= start and stop <= end[k]), None)
            if here:
                last_start, last_stop, last_rest = here[-1]
                if rest is None and still(start, stop):
                    here[-1] = (last_start, stop, last_rest)
                    continue
                if rest is not None and (last_rest == rest or (last_rest is None and still(last_start, last_stop))):
                    here[-1] = (last_start, stop, rest)
                    continue
            here.append((start, stop, rest))
        spans += here
    return spans


def _rotation(data: StageData, start: int, stop: int, posterior: Posterior) -> tuple[str, float, str]:
    """Return axis, angle, rad, and signed body axis of a rotation, see `PositionResidual`."""
    body = (data.gyro[start:stop] - posterior.gyro_bias[0]).sum(axis=0) * data.dt
    k = int(np.argmax(np.abs(body)))
    signed = ("-" if body[k] < 0.0 else "+") + "xyz"[k]
    polled = np.flatnonzero(np.isfinite(data.angles[start:stop]).all(axis=1))
    if len(polled) > 1:
        turned = data.angles[start + polled[-1]] - data.angles[start + polled[0]]
        names = [name for name, angle in zip(JOINTS, turned, strict=True) if abs(angle) >= SMALLEST_MOVE]
        if names:
            return "+".join(names), float(turned[np.argmax(np.abs(turned))]), signed
    return "xyz"[k], float(body[k]), signed
