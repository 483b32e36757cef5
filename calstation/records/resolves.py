"""Record of the offline solutions of the logs in a folder: one file with a checksummed line per solution."""

from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter

from calstation.errors import InputError
from calstation.messages import os_reason
from calstation.records.checked_lines import DamagedLineError, append_line, read_lines
from calstation.records.files import locked

#: Longest time to wait for another program that appends a line, s.
_LOCKED_WITHIN = 5.0


@dataclass(frozen=True)
class OnlineDifference:
    """Difference between an offline solution and the result of the run."""

    identical: bool  #: Whether every value and sigma is bit-identical.
    parameter: str = ""  #: The parameter with the largest difference; "" if the solutions have none in common.
    sigmas: float | None = None  #: Magnitude of this difference in sigmas; None if it is not finite.


@dataclass(frozen=True)
class ResolveRecord:
    """An offline solution of a log."""

    utc: str  #: Time of the solution, ISO 8601.
    by: str | None  #: User of the computer.
    log: str  #: File name of the log.
    log_sha256: str
    first_seq: int
    last_seq: int
    stages: tuple[str, ...]  #: Solved stages.
    states_added: tuple[str, ...]  #: States added to the error model of the log.
    software: str  #: Version of the program.
    configuration_sha256: str | None
    passed: bool | None  #: None if there are no limits, or data and model were not tested.
    difference: OnlineDifference | None  #: None if the log has no result of a run.
    tested: bool = True  #: Whether data and model were tested; stored only if False.


_RECORD = TypeAdapter(ResolveRecord)


def resolves_path(folder: Path) -> Path:
    """Return the file of the offline solutions of the logs in a folder."""
    return folder / "resolves.jsonl"


def append_resolve(folder: Path, record: ResolveRecord) -> None:
    """Append a record to the file of a folder. Raises OSError, also if another program keeps the file locked."""
    with locked(folder / ".resolves.lock", _LOCKED_WITHIN):
        content = asdict(record)
        if record.tested:
            del content["tested"]
        append_line(resolves_path(folder), content)


def read_resolves(folder: Path) -> list[ResolveRecord]:
    """Read the records of a folder, the oldest first; none if there is no file. Raises InputError."""
    path = resolves_path(folder)
    try:
        return [_RECORD.validate_python(line.content) for line in read_lines(path).lines]
    except OSError as exc:
        raise InputError("result.unreadable", file=path, reason=os_reason(exc)) from exc
    except DamagedLineError as exc:
        raise InputError("result.resolves_damaged", file=path, line=exc.number, why=exc.why) from exc
    except ValueError as exc:
        raise InputError("result.resolves_unknown", file=path) from exc
