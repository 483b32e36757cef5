"""Comparison of the solutions of two versions: changed verdicts, and changes of the parameters."""

import os
from collections.abc import Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calstation.fleet.columns import ColumnFiles, latest_rows
from calstation.fleet.comparison import GROUPS, VERDICTS, Comparison, Group, ParameterShift, VerdictChange
from calstation.jobs import ProgressCallback
from calstation.physics import NAMES, FloatArray

#: Fraction of the progress that belongs to the update of the columns.
_UPDATE_FRACTION = 0.9


def update_progress(report: ProgressCallback, begin: float) -> ProgressCallback:
    """Return a progress callback for the update of one of two versions; the update begins at the fraction `begin`."""

    def show(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
        report(_UPDATE_FRACTION * (begin + 0.5 * fraction))

    return show


class CommonLogs:
    """The logs that two versions have in common, given by their rows."""

    def __init__(self, old: ColumnFiles, new: ColumnFiles, numbers: Collection[int] | None) -> None:
        self._old, self._new = old, new
        keys_old, rows_old = latest_rows(old)
        keys_new, rows_new = latest_rows(new)
        count_old, count_new = len(rows_old), len(rows_new)
        if numbers is not None:
            chosen = np.isin(new.numbers("number")[rows_new], np.fromiter(numbers, np.int64))
            keys_new, rows_new = keys_new[chosen], rows_new[chosen]
            is_chosen = np.isin(keys_old, keys_new)
            keys_old, rows_old = keys_old[is_chosen], rows_old[is_chosen]
        index = np.minimum(np.searchsorted(keys_new, keys_old), len(keys_new) - 1)
        common = keys_new[index] == keys_old
        self._rows_old, self._rows_new = rows_old[common], rows_new[index[common]]
        self._only = (len(rows_old) - len(self._rows_old), len(rows_new) - len(self._rows_new))
        order = np.argsort(self._rows_old, kind="stable")  # reading columns in order is faster
        self._rows_old, self._rows_new = self._rows_old[order], self._rows_new[order]
        self._whole_old, self._whole_new = (
            len(rows) == count and bool((rows == np.arange(count)).all())
            for rows, count in ((self._rows_old, count_old), (self._rows_new, count_new))
        )

    def comparison(self, report: ProgressCallback, before: str, after: str) -> Comparison:
        """Return the comparison; `before` and `after` are the names of the versions."""
        was, now = (self._codes(files, "verdict", VERDICTS)[0] for files in (self._old, self._new))
        table = np.bincount(was * len(VERDICTS) + now, minlength=len(VERDICTS) ** 2).reshape(2 * (len(VERDICTS),))
        kinds = {kind: self._codes(self._old, kind) for kind in GROUPS}
        groups = {kind: _Groups(codes, names) for kind, (codes, names) in kinds.items()}
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            shifts = dict(zip(NAMES, pool.map(lambda name: self._shifts(name, groups), NAMES), strict=True))
        overall = {name: each[0] for name, each in shifts.items()}
        by_group = {kind: {name: each[1][kind] for name, each in shifts.items()} for kind in GROUPS}
        worst_rows = {each[-1] for each in overall.values() if each is not None}
        for kind in GROUPS:
            worst_rows |= {each[-1] for of_groups in by_group[kind].values() for each in of_groups if each is not None}
        logs = self._texts(self._old, self._rows_old, sorted(worst_rows), "location", "serial")
        down, up = (was == 0) & (now == 1), (was == 1) & (now == 0)
        report(1.0)
        return Comparison(
            before,
            after,
            len(was),
            *self._only,
            {
                old: {new: int(table[i, j]) for j, new in enumerate(VERDICTS) if table[i, j]}
                for i, old in enumerate(VERDICTS)
                if table[i].any()
            },
            self._changes(np.flatnonzero(was != now)),
            _named(overall, logs),
            {
                kind: tuple(
                    Group(
                        name,
                        int(each.counts[k]),
                        int(np.count_nonzero(down[each.rows(k)])),
                        int(np.count_nonzero(up[each.rows(k)])),
                        _named({parameter: of_groups[k] for parameter, of_groups in by_group[kind].items()}, logs),
                    )
                    for k, name in each.named
                )
                for kind, each in groups.items()
            },
        )

    def _codes(self, files: ColumnFiles, name: str, known: tuple[str, ...] = ()) -> tuple[NDArray[np.int64], list[str]]:
        """Return the code of the text in each row, and the texts."""
        names = {text: code for code, text in enumerate(known)}
        parts = []
        for chunk in files.read(name).column(0).chunks:
            texts = chunk.dictionary.to_pylist()
            code_of_text = np.array([*(names.setdefault(text or "", len(names)) for text in texts), -1])
            codes = code_of_text[chunk.indices.fill_null(len(code_of_text) - 1).to_numpy(zero_copy_only=False)]
            if chunk.null_count:
                codes[codes < 0] = names.setdefault("", len(names))
            parts.append(codes)
        rows = self._rows_old if files is self._old else self._rows_new
        return np.concatenate(parts)[rows], list(names)

    def _shifts(self, name: str, groups: Mapping[str, "_Groups"]) -> tuple["_Shift", dict[str, list["_Shift"]]]:
        """Return the changes of a parameter over all logs and by group."""
        old, old_sigma, new, new_sigma = (
            files.numbers(column) if whole else files.numbers(column)[rows]
            for files, rows, whole in (
                (self._old, self._rows_old, self._whole_old),
                (self._new, self._rows_new, self._whole_new),
            )
            for column in (name, f"{name}_sigma")
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            sizes = np.abs(new - old) / np.maximum(new_sigma, old_sigma)
        sizes[new == old] = 0.0
        return _shift(sizes, None), {kind: each.shifts(sizes) for kind, each in groups.items()}

    def _texts(
        self, files: ColumnFiles, rows: NDArray[np.intp], numbers: list[int], *names: str
    ) -> dict[int, tuple[Any, ...]]:
        """Return the texts in the common rows with the given `numbers`."""
        chosen = files.read(*names, threads=True).take(rows[np.array(numbers, np.intp)])
        return dict(zip(numbers, zip(*(chosen.column(name).to_pylist() for name in names), strict=True), strict=True))

    def _changes(self, changed: NDArray[np.intp]) -> tuple[VerdictChange, ...]:
        rows = changed.tolist()
        names = ("serial", "location", "product", "station", "started_utc", "verdict", "failed_checks")
        old = self._texts(self._old, self._rows_old, rows, *names)
        new = self._texts(self._new, self._rows_new, rows, "verdict", "failed_checks")
        changes = [
            VerdictChange(serial or "", log, product, station, start, was, new[k][0], checks, new[k][1])
            for k, (serial, log, product, station, start, was, checks) in old.items()
        ]
        return tuple(sorted(changes, key=lambda each: (each.product or "", each.station or "", each.started_utc or "")))


#: Median, 95th percentile and maximum of a change, and the row of the maximum; None if no log has the parameter.
_Shift = tuple[float, float, float, int] | None


class _Groups:
    """The rows of each group."""

    def __init__(self, codes: NDArray[np.int64], names: list[str]) -> None:
        self.counts = np.bincount(codes, minlength=len(names))
        self._order = np.argsort(codes, kind="stable")
        self._ends = np.cumsum(self.counts)
        self._names = names

    @property
    def named(self) -> list[tuple[int, str]]:
        """Numbers and names of the groups with rows, sorted by name."""
        return sorted(((k, name) for k, name in enumerate(self._names) if self.counts[k]), key=lambda each: each[1])

    def rows(self, k: int) -> NDArray[np.intp]:
        """Return the rows of a group."""
        return self._order[self._ends[k] - self.counts[k] : self._ends[k]]

    def shifts(self, shift_sizes: FloatArray) -> list[_Shift]:
        """Return the changes in each group."""
        if len(self._names) == 1:
            return [_shift(shift_sizes, None)]
        return [_shift(shift_sizes[self.rows(k)], self.rows(k)) for k in range(len(self._names))]


def _shift(sizes: FloatArray, rows: NDArray[np.intp] | None) -> _Shift:
    """Return the distribution of changes; NaN means that a log does not contain the parameter."""
    present = np.flatnonzero(~np.isnan(sizes)) if np.isnan(sizes.sum()) else None
    if present is not None:
        rows = present if rows is None else rows[present]
        sizes = sizes[present]
    if not len(sizes):
        return None
    ordered = np.sort(sizes)  # sorting is faster than selecting the few values
    count = len(sizes)
    median = 0.5 * float(ordered[(count - 1) // 2] + ordered[count // 2])
    position = 0.95 * (count - 1)
    below, above = ordered[int(position)], ordered[min(int(position) + 1, count - 1)]
    largest = int(np.argmax(sizes))
    row = largest if rows is None else int(rows[largest])
    return median, float(below + (position - int(position)) * (above - below)), float(sizes[largest]), row


def _named(shifts: Mapping[str, _Shift], logs: Mapping[int, tuple[Any, ...]]) -> dict[str, ParameterShift]:
    return {
        name: ParameterShift(*each[:3], log=logs[each[3]][0], serial=logs[each[3]][1] or "")
        for name, each in shifts.items()
        if each is not None
    }
