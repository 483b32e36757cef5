"""Yield is the fraction of passed runs, overall and for the first run of each unit."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from calstation.quality import FailedCheck, Share, count_yields
from calstation.records import Categories, CheckId, RunColumns

BEGIN = datetime(2026, 11, 2, 12, tzinfo=UTC)  # noon, so that the date is the same in nearly all time zones

#: Day, serial, verdict, whether partial, station, operator and failed checks of runs.
ROWS = [
    (0, "A", "failed", False, "s1", "li", ("x", "y")),
    (0, "A", "passed", False, "s1", "li", ()),
    (0, "B", "passed", False, "s2", "wu", ()),
    (1, "B", "failed", False, "s2", None, ("x",)),
    (1, "C", "stopped", False, "s1", "li", ()),
    (1, "C", "partial", True, "s1", "li", ()),
    (1, "C", "failed", True, "s1", "li", ("z",)),
    (2, "C", "failed", False, "s1", "li", ("y",)),
    (2, "D", "passed", False, "s1", "wu", ()),
]


def columns(rows: list[tuple[int, str, str, bool, str | None, str | None, tuple[str, ...]]]) -> RunColumns:
    """Return the runs of one product in columns."""
    days, serials, verdicts, partial, stations, operators, failed = zip(*rows, strict=True)
    started = [(BEGIN + timedelta(days=day, minutes=k)).timestamp() for k, day in enumerate(days)]
    names = tuple(f"run {k}" for k in range(len(rows)))
    products = ("nav",) * len(rows)
    return RunColumns(
        names,
        Categories.of(serials),
        np.array(started),
        *(Categories.of(column) for column in (verdicts, products, stations, operators)),  # type: ignore[arg-type]
        partial=np.array(partial),
        check_standard=np.array([serial == "GOLD" for serial in serials]),
        missing=np.zeros(len(rows), dtype=bool),
        failed_checks=Categories.of([tuple(CheckId("effects", subject) for subject in each) for each in failed]),
        **{name: {} for name in ("values", "sigmas", "table")},
    )


def test_runs_without_files_count() -> None:
    """Deleting the files of the runs that failed does not raise the yield."""
    runs = columns(ROWS)
    missing = runs.verdicts.isin(("failed",))
    found, whole = count_yields(replace(runs, missing=missing)), count_yields(runs)
    assert found == replace(whole, missing=3)


def counts(found: object) -> dict[str, tuple[int, int]]:
    return {name: (share.passed, share.count) for name, share in found.items()}  # type: ignore[attr-defined]


def test_yield_includes_only_judged_full_runs() -> None:
    found = count_yields(columns(ROWS))
    assert (found.overall.passed, found.overall.count) == (3, 6)
    assert found.partial_failed == 1
    assert (found.first_pass.passed, found.first_pass.count) == (2, 4)  # B and D, not A and C
    assert (found.units.passed, found.units.count) == (2, 4)  # A and D passed in their last runs, B and C did not
    assert counts(found.days) == {"2026-11-02": (2, 3), "2026-11-03": (0, 1), "2026-11-04": (1, 2)}
    assert counts(found.products) == {"nav": (3, 6)}
    assert counts(found.stations) == {"s1": (2, 4), "s2": (1, 2)}
    assert counts(found.operators) == {"li": (1, 3), "wu": (2, 2)}
    assert found.failed_checks == (
        FailedCheck(CheckId("effects", "x"), 2, 2 / 3),
        FailedCheck(CheckId("effects", "y"), 2, 1.0),
    )


def test_runs_of_check_standards_are_excluded() -> None:
    golden = [(day, "GOLD", verdict, False, "s3", "xu", ("g",)) for day in range(3) for verdict in ("failed", "passed")]
    assert count_yields(columns([*ROWS, *golden])) == count_yields(columns(ROWS))


def test_runs_after_the_date_are_not_first_runs_if_a_unit_ran_before() -> None:
    found = count_yields(columns(ROWS), since=(BEGIN + timedelta(days=1)).timestamp())
    assert (found.overall.passed, found.overall.count) == (1, 3)
    assert (found.first_pass.passed, found.first_pass.count) == (1, 2)  # D passed, C did not; B came before


def test_runs_without_a_verdict_have_no_yield() -> None:
    found = count_yields(columns([ROWS[4]]))
    assert found.overall is found.units is found.first_pass is None
    assert (found.days, found.failed_checks) == ({}, ())


def test_wilson_intervals_agree_with_published_values() -> None:
    # R. G. Newcombe, Statistics in Medicine 17, 1998, 857-872, table I, method 3 without continuity correction
    for passed, count, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611)):
        share = Share.of(passed, count)
        assert (share.low, share.high) == pytest.approx((low, high), abs=5e-5)
    assert Share.of(1, 29).low == pytest.approx(0.0061, abs=5e-5)
    assert Share.of(1, 29).high == pytest.approx(0.1718, abs=5e-5)
