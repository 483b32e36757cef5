"""Changes to the stored configuration of logs, from a TOML file."""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calstation import __version__
from calstation.errors import ConfigurationError, InputError
from calstation.records import LogMeta
from calstation.schema import Problem, near_miss, problems_of, read_toml, validate
from procedures import method

#: Sections that solving uses and that may be changed.
SECTIONS = ("site", "imu", "table", "model", "prior", "prior_correlation", "product", "schedule")
#: Entries that identify the unit or describe its samples.
_FIXED = {"imu": ("serial", "sample_rate_hz", "output")}
_LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


@dataclass(frozen=True)
class Changes:
    """Changes to the configuration of logs; their label names the solutions."""

    entries: Mapping[str, Any] = field(default_factory=dict)
    label: str | None = None
    file: str = ""

    @property
    def version(self) -> str:
        """Version of the solutions: that of the software, with ``+label`` if there is one."""
        return __version__ if self.label is None else f"{__version__}+{self.label}"

    @property
    def sha256(self) -> str:
        """Digest of the entries."""
        return hashlib.sha256(json.dumps(self.entries, sort_keys=True).encode()).hexdigest()

    def applied(self, meta: LogMeta) -> LogMeta:
        """Return the changed configuration of a log. Raises InputError if it is not valid for this log."""
        if not self.entries:
            return meta
        return validate(LogMeta, _merged(meta.model_dump(), self.entries), self.file, InputError)


def load_changes(path: Path | None, label: str | None = None) -> Changes:
    """Read a file with sections of a log's configuration, each with only the entries to change; None changes nothing.

    The label is by default the name of the file without suffix. Raises ConfigurationError, also for an unknown entry.
    """
    entries = {} if path is None else read_toml(path)
    file = "" if path is None else str(path)
    for name in entries:
        if name not in SECTIONS:
            raise ConfigurationError("fleet.not_changeable", file=file, entry=name, remedy=near_miss(name, SECTIONS))
        for key in _FIXED.get(name, ()):
            if key in entries[name]:
                raise ConfigurationError("fleet.fixed_entry", file=file, entry=f"{name}.{key}")
    problems = problems_of(LogMeta, {"site": {}, "imu": {}, **entries})
    if not problems or all(problem.kind == "missing" for problem in problems):
        for stage, schedule in entries.get("schedule", {}).items():
            problems += problems_of(method(stage).schedule, schedule)
    found: list[Problem] = [problem for problem in problems if problem.kind != "missing"]  # the log has the rest
    if found:
        raise ConfigurationError("entry.in_file", file=file, what=found[0].as_text)
    label = label or (None if path is None else path.stem)
    if label is not None and not _LABEL.fullmatch(label):
        raise ConfigurationError("fleet.label_letters", label=label)
    return Changes(entries, label, file)


def _merged(old: Any, new: Any) -> Any:
    """Return a table with changed entries; tables are merged, other values replaced."""
    if not isinstance(old, dict) or not isinstance(new, Mapping):
        return new
    return {**old, **{name: _merged(old.get(name), value) for name, value in new.items()}}
