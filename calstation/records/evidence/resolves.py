"""Record of the offline solutions of the logs in a folder, a chained file with one line per solution."""

from dataclasses import asdict, dataclass
from pathlib import Path

from calstation.records.evidence.chained_lines import ChainedFile


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
    tested: bool = True  #: Whether data and model were tested.


def resolve_file(folder: Path) -> ChainedFile[ResolveRecord]:
    """Return the file of the offline solutions of the logs in a folder."""
    return ChainedFile(folder / "resolves.jsonl", ResolveRecord)


def append_resolve(folder: Path, record: ResolveRecord) -> None:
    """Append a record to the file of a folder. Raises OSError, for example if the file stays locked."""
    file = resolve_file(folder)
    with file.locked():
        file.append(asdict(record))


def read_resolves(folder: Path) -> list[ResolveRecord]:
    """Read the records of a folder, the oldest first; an empty list if there is no file. Raises InputError."""
    return resolve_file(folder).entries("result.resolves_damaged")
