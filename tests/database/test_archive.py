"""The log archive: verified copies in a folder and in S3, interrupted copies, and reading copies back."""

import hashlib
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from calstation.database.archive import archive_log, copy_from_archive
from calstation.errors import InputError
from tests.helpers import ignore_progress
from tests.s3 import bucket as bucket

CONTENT = bytes(range(256)) * 100_000  # 25.6 MB: S3 takes it in several parts
DIGEST = hashlib.sha256(CONTENT).hexdigest()

#: Program that archives a log and is killed after `AFTER` bytes have been written.
KILLED = """
import os, shutil, signal, sys
from pathlib import Path
from calstation.database.archive import archive_log

def copy(source, target, length):
    target.write(source.read({after}))
    target.flush()
    os.kill(os.getpid(), signal.SIGKILL)

shutil.copyfileobj = copy
archive_log(Path(sys.argv[1]), sys.argv[2], "line 1")
"""

#: Program that archives a log where a file can have 1 MB.
FULL = """
import resource, signal, sys
from pathlib import Path
from calstation.database.archive import archive_log
from calstation.errors import InputError

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
try:
    archive_log(Path(sys.argv[1]), sys.argv[2], "line 1")
except InputError as error:
    print(error.code)
"""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "SN-000001_20261123T120000.h5"
    path.write_bytes(CONTENT)
    return path


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """An archive in an existing folder, like a mounted share."""
    made = tmp_path / "share"
    made.mkdir()
    return made


def archived(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_log_is_copied_to_a_folder_and_read_back(log: Path, archive: Path, tmp_path: Path) -> None:
    copy = archive_log(log, str(archive), "line 1")
    assert (copy.url, copy.file_sha256, copy.size) == (f"{archive}/line 1/{log.name}", DIGEST, len(CONTENT))
    assert archived(archive / "line 1") == [log.name]
    copy_from_archive(copy.url, tmp_path / "copy.h5", ignore_progress)
    assert (tmp_path / "copy.h5").read_bytes() == CONTENT


@pytest.mark.long
def test_log_is_copied_to_s3_and_read_back(log: Path, bucket: str, tmp_path: Path) -> None:
    import s3fs

    copy = archive_log(log, bucket, "line 1")
    assert copy.url == f"{bucket}/line 1/{log.name}"
    assert archive_log(log, bucket, "line 1") == copy
    names = s3fs.S3FileSystem(skip_instance_cache=True).ls(f"{bucket}/line 1")
    assert names == [f"calibration-logs/plant-2/line 1/{log.name}"]
    fractions: list[float] = []
    copy_from_archive(copy.url, tmp_path / "copy.h5", lambda fraction, *_: fractions.append(fraction))
    assert (tmp_path / "copy.h5").read_bytes() == CONTENT
    assert fractions[-1] == 1.0
    assert len(fractions) > 2


def test_identical_copy_is_skipped_and_damaged_copy_is_replaced(log: Path, archive: Path) -> None:
    copy = archive_log(log, str(archive), "line 1")
    there = archive / "line 1" / log.name
    stamp = there.stat()
    assert archive_log(log, str(archive), "line 1") == copy
    assert (there.stat().st_ino, there.stat().st_mtime_ns) == (stamp.st_ino, stamp.st_mtime_ns)
    there.write_bytes(CONTENT[:-1] + b"x")
    assert archive_log(log, str(archive), "line 1") == copy
    assert there.read_bytes() == CONTENT


def test_copy_that_reads_back_differently_is_not_published(
    log: Path, archive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import shutil

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copyfileobj", lambda source, target, length: target.write(source.read()[:-1]))
        with pytest.raises(InputError) as refused:
            archive_log(log, str(archive), "line 1")
    assert refused.value.code == "database.copy_damaged"
    assert archived(archive / "line 1") == []
    archive_log(log, str(archive), "line 1")
    assert archived(archive / "line 1") == [log.name]


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
@pytest.mark.parametrize("after", [0, 1_000_000, len(CONTENT)])
def test_interrupted_copy_leaves_no_file_with_the_final_name(log: Path, archive: Path, after: int) -> None:
    command = [sys.executable, "-c", KILLED.format(after=after), str(log), str(archive)]
    assert subprocess.run(command, timeout=120).returncode == -signal.SIGKILL
    assert log.name not in archived(archive / "line 1")
    archive_log(log, str(archive), "line 1")
    assert archived(archive / "line 1") == [log.name]
    assert (archive / "line 1" / log.name).read_bytes() == CONTENT


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit of file sizes")
def test_full_archive_is_reported_and_leaves_no_file(log: Path, archive: Path) -> None:
    command = [sys.executable, "-c", FULL, str(log), str(archive)]
    assert (
        subprocess.run(command, timeout=120, capture_output=True, text=True).stdout.strip() == "database.archive_failed"
    )
    assert archived(archive / "line 1") == []


def test_missing_archive_is_reported(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "share").write_text("the share is not mounted")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "station")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    for archive, code in (
        (str(tmp_path / "share"), "archive_absent"),
        (str(tmp_path / "unmounted" / "logs"), "archive_absent"),
        ("s3://calibration-logs", "archive_failed"),
        ("tape://logs", "no_archive"),
    ):
        with pytest.raises(InputError) as failed:
            archive_log(log, archive, "line 1")
        assert failed.value.code == f"database.{code}"
    assert not (tmp_path / "unmounted").exists()
    for url in (str(tmp_path / "gone.h5"), "s3://calibration-logs/gone.h5"):
        with pytest.raises(InputError) as failed:
            copy_from_archive(url, tmp_path / "copy.h5", ignore_progress)
        assert failed.value.code == "database.log_not_read"
        assert "Errno" not in str(failed.value)
