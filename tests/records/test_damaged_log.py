"""A log with damaged bytes, closed or not, is read or refused with one message, and never blocks the reader."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from records_samples import META, make_block

from calstation.errors import InputError
from calstation.records import LogMeta, RawLogWriter, open_log
from calstation.records.raw.superblock import SUPERBLOCK, _lookup3, is_unclosed, superblock_valid

ROWS = 650


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A closed log, and the same log just before closing."""
    path = tmp_path_factory.mktemp("logs") / "run.h5"
    writer = RawLogWriter(path, LogMeta.model_validate(META))
    for block in (make_block("", 0, 50), make_block("rate", 50, 400), make_block("excitation", 460, 200)):
        writer.append(block)
    writer.event({"event": "StageSolved", "stage": "rate"})
    writer.sync()
    left = path.read_bytes()
    writer.close("passed")
    return {"closed": path.read_bytes(), "left open": left}


def rows(path: Path) -> int:
    """Return the number of readable samples, -1 if the log is reported as damaged."""
    try:
        return sum(len(block) for block in open_log(path).blocks())
    except InputError as error:
        return -1 if "\n" not in str(error) else -2


def write(path: Path, data: bytes) -> Path:
    """Write a file with an old modification time, so that it counts as not being written."""
    path.write_bytes(data)
    os.utime(path, (0.0, 0.0))
    return path


def test_unclosed_log_reads_like_a_closed_log(tmp_path: Path, logs: dict[str, bytes]) -> None:
    for name, data in logs.items():
        assert is_unclosed(data) is (name == "left open")
        assert superblock_valid(data[:SUPERBLOCK])
        assert rows(write(tmp_path / "run.h5", data)) == ROWS
    alike = open_log(tmp_path / "run.h5")
    assert [event["event"] for event in alike.events] == ["StageSolved"]
    assert alike.outcome is None


@pytest.mark.long
@pytest.mark.parametrize("name", ["closed", "left open"])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_bytes_never_block_the_reader(
    tmp_path: Path, logs: dict[str, bytes], name: str, data: st.DataObject
) -> None:
    spoilt = bytearray(logs[name])
    used = [place for place, byte in enumerate(spoilt) if byte]
    for _ in range(data.draw(st.integers(1, 4))):
        # Half of the wrong bytes are in the metadata of the file.
        place = data.draw(st.sampled_from(used[:1500]) | st.sampled_from(used))
        spoilt[place] = data.draw(st.sampled_from([0, 255, spoilt[place] ^ 1, spoilt[place] ^ 128]))
    assert -1 <= rows(write(tmp_path / "run.h5", bytes(spoilt))) <= ROWS


@pytest.mark.parametrize("name", ["closed", "left open"])
def test_truncated_log_never_blocks_the_reader(tmp_path: Path, logs: dict[str, bytes], name: str) -> None:
    whole = logs[name]
    for length in range(0, len(whole), len(whole) // 60):
        assert -1 <= rows(write(tmp_path / "run.h5", whole[:length])) <= ROWS


@pytest.mark.parametrize(
    ("data", "expected"),
    [(b"", 0xDEADBEEF), (b"Four score and seven years ago", 0x17770551)],
)
def test_checksum_agrees_with_its_published_values(data: bytes, expected: int) -> None:
    assert _lookup3(data) == expected
