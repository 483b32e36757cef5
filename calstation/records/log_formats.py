"""File formats of logs; a new format needs a module that reads and writes it and one entry in `LOG_FORMATS`."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock
from calstation.records.csv_logs import (
    CSV_SUFFIXES,
    csv_files,
    csv_rows,
    meta_path,
    open_csv,
    open_folder,
    write_csv_log,
)
from calstation.records.foreign import foreign_format, open_foreign
from calstation.records.log import Log
from calstation.records.meta import LogMeta
from calstation.records.raw import SUFFIX, open_raw, row_count, write_log


@dataclass(frozen=True)
class LogFormat:
    """A file format of logs."""

    name: str
    suffixes: tuple[str, ...]
    #: Opens a log, given its path and the path of its configuration (None for the default). Raises InputError.
    open: Callable[[Path, Path | None], Log]
    #: Writes samples and configuration; a failure leaves no log. Raises InputError or ConfigurationError.
    write: Callable[[Path, LogMeta, Iterator[SampleBlock]], object]
    #: Returns the number of samples, possibly estimated. Raises InputError.
    count_rows: Callable[[Path], int]
    #: Returns the path of the configuration next to a log; None if the configuration is in the log itself.
    configuration_path: Callable[[Path], Path] | None = None


LOG_FORMATS = (
    LogFormat("raw log", (SUFFIX,), open_raw, write_log, row_count),
    LogFormat("CSV", CSV_SUFFIXES, open_csv, write_csv_log, csv_rows, meta_path),
)
#: Suffixes of all formats, the longest first.
LOG_SUFFIXES = tuple(sorted((s for each in LOG_FORMATS for s in each.suffixes), key=len, reverse=True))


def log_format(path: Path) -> LogFormat | None:
    """Determine the format of a log from its name; return None for any other file."""
    return next((each for each in LOG_FORMATS if path.name.endswith(each.suffixes)), None)


def open_log(path: Path, meta_file: Path | None = None, topic: str | None = None) -> Log:
    """Open a log or a recording of any format.

    Raises InputError if the file is missing or of another type, or if its configuration is invalid.

    Parameters
    ----------
    path : the file, or a folder of CSV files
    meta_file : its configuration, if the file does not contain it; None for the TOML next to it
    topic : topic in a file of a foreign format; None for the only IMU in the file
    """
    if foreign_format(path) is not None:
        return open_foreign(path, meta_file, topic)
    if path.is_dir():
        return open_folder(path, meta_file)
    return _required_format(path).open(path, meta_file)


def estimated_rows(path: Path) -> int:
    """Return the number of samples in a log, possibly estimated; 1 for a foreign format. Raises InputError."""
    if foreign_format(path) is not None:
        return 1
    if path.is_dir():
        return sum(map(csv_rows, csv_files(path)))
    return max(1, _required_format(path).count_rows(path))


def _required_format(path: Path) -> LogFormat:
    known = log_format(path)
    if known is None:
        raise InputError("log.not_a_log", file=path)
    return known
