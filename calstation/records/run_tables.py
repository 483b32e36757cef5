"""Tables of the run index, and the conditions by which runs are found in them."""

import re
from typing import Any

import sqlalchemy as sa

from calstation.records.indexed_run import IndexedRun, RunFilter, to_columns

#: Time in the file name of a log or in the identifier of a batch.
_TIME_STAMP = re.compile(r"_?\d{8}T\d{6,}", re.IGNORECASE)

#: Part of a file name or of the identifier of a batch that contains digits of its date or time.
_PART_OF_NAME = re.compile(r"_\d{1,8}(T\d*)?$|\d{8}T\d*", re.IGNORECASE)
#: Time of day in a file name; fewer digits would match too many names.
_TIME_OF_DAY = re.compile(r"\d{6,}")

#: Content of `failed_checks` if no check failed.
NO_CHECKS = "[]"
#: Fields of a run with a column of their own. Column `text` of the table contains the text to search and `content` the
#: whole `RunRecord` as JSON. `parameters` is a list of names and `failed_checks` a list of kinds and subjects as JSON.
#: `numbers` contains the values of all parameters and of the table's quantities, followed by their sigmas, as float64,
#: so that 100,000 runs are read at once without parsing.
_SEARCHED = ("serial", "started_utc", "verdict", "product", "station", "operator", "resumed_from", "batch", "slot")
_FLAGS = ("altered", "missing", "simulated")
#: Columns of the conditions; their index lets a query find matching runs without reading the contents of other runs.
_FILTERED = ("started_utc", "name", "verdict", *_FLAGS, "product", "station", "operator", "batch", "text")
METADATA = sa.MetaData()
RUNS = sa.Table(
    "runs",
    METADATA,
    sa.Column("origin", sa.String, primary_key=True),
    sa.Column("name", sa.String, primary_key=True),
    sa.Column("stamp", sa.String, nullable=False),
    *(sa.Column(name, sa.String, index=name == "serial") for name in _SEARCHED),
    sa.Column("text", sa.String, nullable=False),
    sa.Column("content", sa.String, nullable=False),
    sa.Column("partial", sa.Boolean, nullable=False),
    sa.Column("altered", sa.Boolean, nullable=False),
    sa.Column("missing", sa.Boolean, nullable=False),
    sa.Column("simulated", sa.Boolean, nullable=False),
    sa.Column("check_standard", sa.Boolean, nullable=False),
    sa.Column("failed_checks", sa.String, nullable=False),
    sa.Column("parameters", sa.String, nullable=False),
    sa.Column("numbers", sa.LargeBinary, nullable=False),
)
sa.Index("runs_filtered", *(RUNS.c[name] for name in _FILTERED))
#: One row with the shared database from which runs of other folders were received, and the last revision received.
RECEIVED = sa.Table(
    "received", METADATA, sa.Column("database", sa.String, primary_key=True), sa.Column("revision", sa.BigInteger)
)
#: Copy of the stamps of runs and of URLs of copied logs that the shared database has acknowledged.
ACKNOWLEDGED = sa.Table(
    "acknowledged",
    METADATA,
    sa.Column("kind", sa.String, primary_key=True),
    sa.Column("name", sa.String, primary_key=True),
    sa.Column("stamp", sa.String, nullable=False),
)
#: One row, added by the first exchange, with the revision of the acknowledged stamps in the shared database.
ACKNOWLEDGED_AT = sa.Table("acknowledged_at", METADATA, sa.Column("revision", sa.BigInteger, primary_key=True))
#: One row, added by the first change of the runs, with a random value that every change replaces.
CHANGED = sa.Table("changed", METADATA, sa.Column("mark", sa.String, primary_key=True))
PRESENT = sa.not_(RUNS.c.missing)
MEASURED = sa.not_(RUNS.c.simulated)
CHANGE_TOKEN = sa.select(CHANGED.c.mark)
LATEST = (RUNS.c.started_utc.desc(), RUNS.c.name.desc())
ROWID: sa.ColumnElement[int] = sa.literal_column("runs.rowid", sa.Integer)


def sort_key(field: str) -> sa.ColumnElement[Any]:
    """Return the expression by which runs are sorted by a field of `RunRecord`."""
    if field == "started_utc":
        return RUNS.c.started_utc
    value = RUNS.c[field] if field in _SEARCHED else sa.func.json_extract(RUNS.c.content, f"$.{field}")
    return sa.func.natural_key(sa.func.coalesce(value, ""))


def conditions_of(run_filter: RunFilter) -> list[sa.ColumnElement[bool]]:
    """Return the conditions that the runs of a filter meet."""
    columns = ("verdict", "product", "station", "operator", "batch")
    conditions = [RUNS.c[name] == getattr(run_filter, name) for name in columns if getattr(run_filter, name)]
    if run_filter.altered is not None:
        conditions.append(RUNS.c.altered == run_filter.altered)
    if run_filter.missing is not None:
        conditions.append(RUNS.c.missing == run_filter.missing)
    if run_filter.simulated is not None:
        conditions.append(RUNS.c.simulated == run_filter.simulated)
    if run_filter.since:
        conditions.append(RUNS.c.started_utc >= run_filter.since)
    if run_filter.before:
        conditions.append(RUNS.c.started_utc < run_filter.before)
    if run_filter.names:
        conditions.append(RUNS.c.name.in_(run_filter.names))
    if search := run_filter.search.strip():
        searched = [(RUNS.c.text, search.casefold())]
        if _PART_OF_NAME.search(search):
            searched = [(RUNS.c.name, search), (RUNS.c.batch, search), *searched]
        elif _TIME_OF_DAY.fullmatch(search):
            searched.append((RUNS.c.name, f"T{search}"))
        conditions.append(sa.or_(*(column.contains(text, autoescape=True) for column, text in searched)))
    return conditions


def row_of(run: IndexedRun) -> dict[str, Any]:
    """Return the columns of a run in the table of the runs."""
    record = run.record
    columns = {name: getattr(record, name) for name in _SEARCHED}
    texts = (record.serial, run.name, record.product, record.station, record.operator, record.batch)
    # without date and time, whose digits a serial number would match; names and identifiers are searched separately
    columns["text"] = _TIME_STAMP.sub("", "\n".join(filter(None, texts))).casefold()
    columns["partial"] = record.partial
    columns["altered"] = record.altered
    columns["missing"] = record.missing
    columns["simulated"] = record.simulated
    columns["check_standard"] = record.check_standard
    return {"origin": record.origin, "name": run.name, "stamp": run.stamp, **columns, **to_columns(run)}
