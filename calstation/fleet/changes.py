"""Changes to the stored configuration of logs, which are read from a TOML file."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calstation import __version__
from calstation.errors import ConfigurationError, InputError
from calstation.messages import Text
from calstation.records import LogMeta
from calstation.schema import near_miss, problems_of, read_toml, validate
from procedures import method

#: Sections that the solvers use and that may be changed.
SECTIONS = ("site", "imu", "table", "model", "prior", "prior_correlation", "product", "schedule")
#: Section of the file that contains factors for entries of the same sections.
SCALE = "scale"
#: Entries that a log contains only if they were measured; a factor does not apply to a computed value.
_MEASURED = ("site.gravity_mps2",)
#: Kinds of problems of values that do not apply to factors.
_NOT_OF_FACTORS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
#: Entries that identify the unit or describe its samples.
_FIXED = {"imu": ("serial", "sample_rate_hz", "output")}
_LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


@dataclass(frozen=True)
class Changes:
    """Changes to the configuration of logs, and a label that is part of the version of the solutions."""

    entries: Mapping[str, Any] = field(default_factory=dict)
    label: str | None = None
    file: str = ""

    @property
    def version(self) -> str:
        """Version of the solutions: the software version, followed by ``+label`` if there is a label."""
        return __version__ if self.label is None else f"{__version__}+{self.label}"

    @property
    def sha256(self) -> str:
        """Digest of the entries."""
        return hashlib.sha256(json.dumps(self.entries, sort_keys=True).encode()).hexdigest()

    def applied(self, meta: LogMeta) -> LogMeta:
        """Return the changed configuration of a log; values are replaced first, then scaled.

        Raises InputError if the result is invalid for this log, or if the log lacks a value to scale.
        """
        if not self.entries:
            return meta
        values = {name: entries for name, entries in self.entries.items() if name != SCALE}
        changed = _scaled(_merged(meta.model_dump(), values), self.entries.get(SCALE, {}))
        return validate(LogMeta, changed, self.file, InputError)


def load_changes(path: Path | None, label: str | None = None) -> Changes:
    """Read a file with the entries of a log's configuration that are to be changed; return no changes for None.

    The default label is the name of the file without its suffix. Raises ConfigurationError, also if an entry is unknown
    or the file changes nothing.
    """
    entries = {} if path is None else read_toml(path)
    file = "" if path is None else str(path)
    factors = entries.get(SCALE, {})
    if path is not None and not any(_leaves(entries)):
        raise ConfigurationError("fleet.no_changes", file=file)
    if not isinstance(factors, Mapping):
        raise ConfigurationError("fleet.not_changeable", file=file, entry=SCALE, remedy=Text("fleet.scale_is_a_table"))
    for entry, factor in _leaves(factors, SCALE):
        if isinstance(factor, bool) or not isinstance(factor, int | float) or factor <= 0:
            raise ConfigurationError("fleet.not_a_factor", file=file, entry=entry, value=str(factor))
    _check({name: values for name, values in entries.items() if name != SCALE}, file)
    _check(factors, file, SCALE)
    label = label or (None if path is None else path.stem)
    if label is not None and not _LABEL.fullmatch(label):
        raise ConfigurationError("fleet.label_letters", label=label)
    return Changes(entries, label, file)


def _check(entries: Any, file: str, section: str = "") -> None:
    """Check the entries of a section. Raises ConfigurationError if it cannot be changed or an entry is wrong."""
    prefix = f"{section}." if section else ""
    for name in entries:
        if name not in SECTIONS:
            permitted = SECTIONS if section else (*SECTIONS, SCALE)
            raise ConfigurationError(
                "fleet.not_changeable", file=file, entry=f"{prefix}{name}", remedy=near_miss(name, permitted)
            )
        for key in _FIXED.get(name, ()):
            if isinstance(entries[name], Mapping) and key in entries[name]:
                raise ConfigurationError("fleet.fixed_entry", file=file, entry=f"{prefix}{name}.{key}")
    ignored = ("missing", *(_NOT_OF_FACTORS if section else ()))  # the log contains the other entries
    problems = problems_of(LogMeta, {"site": {}, "imu": {}, **entries})
    if all(problem.kind in ignored for problem in problems):
        for stage, schedule in entries.get("schedule", {}).items():
            problems += problems_of(method(stage).schedule, schedule)
    for problem in problems:
        if section and (problem.kind.endswith("_type") or problem.kind in ("literal_error", "int_from_float")):
            raise ConfigurationError("fleet.not_scalable", file=file, entry=f"{prefix}{problem.name}")
        if problem.kind not in ignored:
            raise ConfigurationError("entry.in_file", file=file, what=problem.as_text)


def _leaves(entries: Any, key_path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the name and value of each entry of a table and its nested tables."""
    if not isinstance(entries, Mapping):
        yield key_path, entries
        return
    for name, value in entries.items():
        yield from _leaves(value, f"{key_path}.{name}" if key_path else name)


def _merged(old: Any, new: Any) -> Any:
    """Return a table with changed entries; tables are merged, and other values are replaced."""
    if not isinstance(old, dict) or not isinstance(new, Mapping):
        return new
    return {**old, **{name: _merged(old.get(name), value) for name, value in new.items()}}


def _scaled(old: Any, factors: Any, key_path: str = "") -> Any:
    """Return a table with entries multiplied by factors. Raises InputError if an entry is missing."""
    if isinstance(factors, Mapping):
        table = old if isinstance(old, dict) else {}
        inner = {name: f"{key_path}.{name}" if key_path else name for name in factors}
        return {**table, **{name: _scaled(table.get(name), factors[name], inner[name]) for name in factors}}
    if isinstance(old, list):
        return [_scaled(value, factors, key_path) for value in old]
    if isinstance(old, bool) or not isinstance(old, int | float):
        if old is None and key_path in _MEASURED:
            return None
        raise InputError("fleet.nothing_to_scale", entry=key_path)
    return old * factors
