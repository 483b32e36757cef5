"""Where the excess of a stage's innovations is: in one rest or move, in those of a kind, or everywhere."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calstation.estimation.common.residuals import PositionResidual, StageResiduals

#: Share of the excess from which rests or moves are named.
_MOST = 0.6
#: Scatter is in some rests or moves if its excess per component is this many times that elsewhere.
_DENSER = 3.0
#: Innovations that are not independent: other rows whose largest component is this close, in sigmas, are named too.
_CLOSE = 1.0


@dataclass(frozen=True)
class Concentration:
    """Rests and moves that contain most of the excess, and what is wrong there."""

    where: Literal["rest", "move", "rests_up", "moves_about", "rests", "moves", "stage"]
    rows: tuple[int, ...]  #: Indices of the rows, the worst first.
    share: float  #: Share of the excess of the squares.
    scatter: bool  #: Whether the innovations scatter there, instead of following from a constant error of a channel.


def concentration(residuals: StageResiduals, *, white: bool) -> Concentration:
    """Find the fewest rests or moves of a stage that contain most of its excess.

    The excess is either scatter, which stays where it is, or follows from an error of a channel during these rests or
    moves, whose effect the filter spreads over all that come later. With innovations that are not `white`, only single
    rests or moves are named.
    """
    rows = residuals.rows
    excess = np.array([row.total - row.freedom for row in rows])
    freedom = np.array([row.freedom for row in rows])
    if not white:
        worst = np.array([row.excess if row.freedom else 0.0 for row in rows])
        named = np.flatnonzero(worst > worst.max() - _CLOSE)
        if len(named) > 1:
            return Concentration("stage", _sorted(named, rows), 1.0, scatter=True)
        return Concentration(rows[named[0]].kind, (int(named[0]),), 1.0, scatter=False)
    total = float(excess.sum())
    found: list[Concentration] = []
    level = 0
    for candidate, where, chosen in _candidates(rows):
        if candidate > level and found:
            break
        level = candidate
        others = np.setdiff1d(np.arange(len(rows)), chosen)
        inside, outside = float(excess[chosen].sum()), max(float(excess[others].sum()), 0.0)
        dense = inside * max(freedom[others].sum(), 1) > _DENSER * outside * freedom[chosen].sum()
        scatter = inside / total if dense else 0.0
        shift = 0.0
        if residuals.scores is not None:
            shift = (residuals.scores.explained(chosen) - 6.0 * len(chosen)) / total
        share = min(max(shift, scatter), 1.0)
        if share > _MOST:
            found.append(Concentration(where, _sorted(chosen, rows), share, scatter=scatter > shift))
    everywhere = Concentration("stage", _sorted(range(len(rows)), rows), 1.0, scatter=True)
    return max(found, key=lambda c: c.share, default=everywhere)


_Kind = Literal["rest", "move", "rests_up", "moves_about", "rests", "moves", "stage"]


def _candidates(rows: Sequence[PositionResidual]) -> Iterator[tuple[int, _Kind, list[int]]]:
    """Yield sets of rows with their rank: single ones, those with the same axis, and all rests or moves."""
    for index, row in enumerate(rows):
        yield 1, row.kind, [index]
    by_axis: tuple[tuple[Literal["rest", "move"], _Kind, _Kind], ...] = (
        ("rest", "rests_up", "rests"),
        ("move", "moves_about", "moves"),
    )
    for kind, with_axis, _ in by_axis:
        for axis in dict.fromkeys(row.axis for row in rows if row.kind == kind):
            yield 2, with_axis, [k for k, row in enumerate(rows) if row.kind == kind and row.axis == axis]
    for kind, _, every in by_axis:
        if chosen := [k for k, row in enumerate(rows) if row.kind == kind]:
            yield 3, every, chosen


def _sorted(chosen: Sequence[int] | np.ndarray, rows: Sequence[PositionResidual]) -> tuple[int, ...]:
    return tuple(sorted((int(k) for k in chosen), key=lambda k: -np.nan_to_num(rows[k].worst)))
