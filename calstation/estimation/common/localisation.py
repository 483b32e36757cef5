"""Localisation of the excess of a stage's innovations: one rest or move, all rests or moves of a kind, or all data."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calstation.estimation.common.by_position import PositionResidual, StageResiduals
from calstation.physics import FloatArray

#: Share of the excess above which rests or moves are named.
_MIN_SHARE = 0.5
#: Scatter is attributed to some rests or moves if their excess per component is this many times the excess elsewhere.
_MIN_DENSITY_RATIO = 2.0
#: If a constant error leaves a larger fraction of the share unexplained than this, the excess is scatter.
_SCATTER = 0.15
#: A single rest or move is named if its share is this many times the share of any other.
_MIN_LEAD = 1.5
#: For innovations that are not independent: rests or moves within this many sigmas of the worst are named with it.
_WITHIN_SIGMAS = 1.0

#: One rest or move, those with a common axis, all rests, all moves, or the whole stage.
Location = Literal["rest", "move", "rests_up", "moves_about", "rests", "moves", "stage"]


#: Place names for rests or moves with a common axis, and for all of them.
_LOCATIONS: dict[str, tuple[Location, Location]] = {"rest": ("rests_up", "rests"), "move": ("moves_about", "moves")}


@dataclass(frozen=True)
class Concentration:
    """Rests and moves that contain most of the excess, and the kind of error."""

    location: Location
    rows: tuple[int, ...]  #: Indices of the rests and moves, the worst first.
    share: float  #: Share of the excess of the squares.
    signs: FloatArray | None = None  #: Sign by row of a common channel error; None for scatter.
    axis: str = ""  #: Axis that the rests or moves have in common.


def concentration(residuals: StageResiduals, *, white: bool) -> Concentration:
    """Find the fewest rests or moves of a stage that contain most of its excess.

    The excess is either scatter, which is confined to these rests or moves, or the result of a constant channel error
    during them, whose effect the filter spreads over all later ones. If the innovations are not `white`, the rests or
    moves with the largest ones are named.
    """
    rows = residuals.rows
    if not white:
        worst = np.array([np.nan_to_num(row.excess) for row in rows])
        named = _sorted(np.flatnonzero(worst > worst.max() - _WITHIN_SIGMAS), rows)
        return Concentration(rows[named[0]].kind if 2 * len(named) < len(rows) else "stage", named, 1.0)
    one = sorted(_single(residuals), key=lambda c: -c.share)
    if one[0].share > _MIN_SHARE and one[0].share > _MIN_LEAD * max((c.share for c in one[1:]), default=0.0):
        return one[0]
    for candidates in (_common(residuals), _scattered(rows, by_axis=True), _scattered(rows)):
        best = max(candidates, key=lambda c: c.share, default=None)
        if best is not None and best.share > _MIN_SHARE:
            return best
    return Concentration("stage", _sorted(range(len(rows)), rows), 1.0)


def _excess(rows: Sequence[PositionResidual]) -> float:
    return sum(row.total - row.freedom for row in rows)


def _single(residuals: StageResiduals) -> Iterator[Concentration]:
    """Yield every rest and move, once with a constant error of all channels and once with the remaining scatter."""
    total, scores = _excess(residuals.rows), residuals.scores
    for k, row in enumerate(residuals.rows):
        remaining = _excess([row])
        shift = 0.0
        if scores is not None:
            remaining -= scores.own_explained(k)
            shift = max(scores.explained([k], np.ones(1)), 0.0)
        share = (shift + max(remaining, 0.0)) / total
        yield Concentration(row.kind, (k,), share, np.ones(1) if remaining < _SCATTER * share * total else None)


def _common(residuals: StageResiduals) -> Iterator[Concentration]:
    """Yield the rests with the same axis up, and the moves about the same joint or body axis, with a common error."""
    rows, scores = residuals.rows, residuals.scores
    if scores is None:
        return
    total = _excess(rows)
    sets: dict[tuple[Location, str], list[int]] = {}
    for k, row in enumerate(rows):
        for axis in dict.fromkeys((row.axis, row.body[1:] or row.axis)):
            sets.setdefault((_LOCATIONS[row.kind][0], axis), []).append(k)
    for (location, axis), chosen in sets.items():
        if len(chosen) > 1:
            ordered = _sorted(chosen, rows)
            signs = np.array([-1.0 if rows[k].body.startswith("-") else 1.0 for k in ordered])
            for sign in (np.ones(len(ordered)), signs):
                share = scores.explained(ordered, sign) / total
                yield Concentration(location, ordered, share, sign, axis)


def _scattered(rows: Sequence[PositionResidual], *, by_axis: bool = False) -> Iterator[Concentration]:
    """Yield the rests with the same axis up and the moves about a joint, or all rests or moves, if they scatter."""
    total, freedom = _excess(rows), sum(row.freedom for row in rows)
    sets: dict[tuple[Location, str], list[int]] = {}
    for k, row in enumerate(rows):
        with_axis, every = _LOCATIONS[row.kind]
        sets.setdefault((with_axis, row.axis) if by_axis else (every, ""), []).append(k)
    for (location, axis), chosen in sets.items():
        inside, share = _excess([rows[k] for k in chosen]), sum(rows[k].freedom for k in chosen) / freedom
        if inside * (1.0 - share) > _MIN_DENSITY_RATIO * (total - inside) * share:
            yield Concentration(location, _sorted(chosen, rows), inside / total, axis=axis)


def _sorted(chosen: Sequence[int] | np.ndarray, rows: Sequence[PositionResidual]) -> tuple[int, ...]:
    return tuple(sorted((int(k) for k in chosen), key=lambda k: -np.nan_to_num(rows[k].worst)))
