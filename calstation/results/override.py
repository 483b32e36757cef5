"""Release of a unit that failed: the result keeps its outcome and records who released the unit and why."""

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel

from calstation.config import (
    ConfirmationRequired,
    Person,
    ProductConfig,
    StationConfig,
    confirm,
    confirmation_required,
    library,
    plain_text,
    site_folder,
)
from calstation.errors import InputError
from calstation.jobs import ProgressCallback
from calstation.parsing import parse_toml, read_json
from calstation.records import FileSection, audit_writer, open_log
from calstation.results.resolving import find_log
from calstation.results.result import Result, write_json
from calstation.results.sections import Override
from calstation.results.stated import load_run_result, override_of
from calstation.schema import validate

T = TypeVar("T", bound=BaseModel)


def override_required(report: ProgressCallback, path: Path) -> ConfirmationRequired:
    """Job: return the confirmation required to release the unit of a result. Raises InputError if not releasable."""
    return confirmation_required("override", *_files(_failed(path), path))


def override_result(report: ProgressCallback, path: Path, why: str, first: Person, second: Person | None) -> Override:
    """Job: release the unit of a failed result; the audit trail is written before the result is changed.

    Parameters
    ----------
    report : progress callback of the job, not used
    path : result file of the run, which is changed
    why : reason for the release
    first, second : person who releases the unit, and a second person if the product requires one

    Raises
    ------
    InputError : if there is no failed run to release, or the reason is missing
    ConfigurationError : see `calstation.config.confirm`; or the audit trail or the result cannot be written
    """
    why = plain_text(why)
    if not why:
        raise InputError("override.no_reason")
    people = confirm("override", *_files(_failed(path), path), first, second)
    with audit_writer(site_folder()) as audit:  # the second of two concurrent releases is then rejected
        result = _failed(path)
        about = {"serial": result.serial, "result": path.name, "log_sha256": result.log.sha256, "pin": people.pin}
        event = audit.append_event("override", people.by, why, confirmed_by=people.confirmed_by, **about)
        override = override_of(event)
        content = read_json(path)
        write_json(path, {**content, "override": override.model_dump()})
    return override


def _failed(path: Path) -> Result:
    """Read a result whose unit can be released. Raises InputError."""
    result = load_run_result(path)
    if result.outcome != "failed":
        raise InputError("override.not_failed", file=path)
    if result.override is not None:
        raise InputError("override.already", file=path, by=result.override.by)
    return result


def _files(result: Result, path: Path) -> tuple[ProductConfig, StationConfig]:
    log = find_log(result, path)
    return run_files(result.configuration, path, {} if log is None else open_log(log).meta.profiles)


def run_files(
    files: Mapping[str, FileSection], path: Path, texts: Mapping[str, str]
) -> tuple[ProductConfig, StationConfig]:
    """Return the product of a run, and its station from the site's library or, if it is not there, from the log.

    `files` are the files of the run, and `texts` their texts in its log, both by kind. Raises InputError for `path` if
    a file is neither in the log nor at the site.
    """
    product = _file("product", ProductConfig, files.get("product"), path, texts.get("product"))
    station = files.get("station")
    in_library = station is not None and station.name in library.names("stations")
    return product, _file("station", StationConfig, station, path, None if in_library else texts.get("station"))


def _file(kind: str, model: type[T], file_section: FileSection | None, path: Path, text: str | None) -> T:
    """Parse the text of a run's file or, without a text, the library file with its name. Raises InputError."""
    if text is not None:
        return validate(model, parse_toml(text), path, InputError)
    if file_section is None or file_section.name not in library.names(f"{kind}s"):
        raise InputError("override.no_files", file=path, kind=kind)
    file = library.find(f"{kind}s", file_section.name)
    return validate(model, parse_toml(file.read_text(encoding="utf-8")), file)
