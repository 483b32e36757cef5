"""A missing home, an unusable folder or a file system without locks gives one clear message, or does not matter."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import numba as nb
import pytest

from calstation.cli.app import run_app
from calstation.config import RunRequest, load_configuration, site_folder
from calstation.errors import ConfigurationError, InputError
from calstation.physics import kernel
from calstation.records import LogMeta, RawLogWriter, being_written, export_csv, files, open_log
from tests.helpers import raises_code
from tests.records.records_samples import META, make_block


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log.h5"
    writer = RawLogWriter(path, LogMeta.model_validate(META))
    writer.append(make_block("rate", 0, 50))
    writer.close("passed")
    return path


def test_without_a_home_the_message_names_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", no_home)
    for name in ("CALSTATION_HOME", "XDG_CONFIG_HOME", "APPDATA"):
        monkeypatch.delenv(name, raising=False)
    with raises_code(ConfigurationError, "configuration.no_home"):
        site_folder()
    monkeypatch.setenv("APPDATA" if os.name == "nt" else "XDG_CONFIG_HOME", "/etc/xdg")
    assert site_folder() == Path("/etc/xdg/calstation")


def test_kernels_are_compiled_where_no_cache_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nb.core.caching.CompileResultCacheImpl, "_locator_classes", [])
    with pytest.raises(RuntimeError, match="no locator"):
        nb.njit(cache=True)(lambda x: x)
    assert kernel(lambda x: x + 1)(1) == 2


def test_an_unusable_site_folder_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("CALSTATION_HOME", "/" + "n" * 300)
    assert run_app(["check"]) == 2
    error = capsys.readouterr().err
    assert "name is too long" in error
    assert "nternal error" not in error


def test_an_argument_that_is_not_utf8_is_refused_before_anything(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(["run", "--yes", "--out", os.fsdecode(b"runs_\xff")]) == 2
    assert r"runs_\udcff is not UTF-8" in capsys.readouterr().err


def test_a_runs_folder_that_is_not_utf8_is_refused_before_a_device_is_opened(tmp_path: Path) -> None:
    with raises_code(ConfigurationError, "run.folder_not_utf8"):
        load_configuration(RunRequest("SN-1", out=tmp_path / os.fsdecode(b"runs_\xff")))


@pytest.mark.parametrize("code", [errno.EROFS, errno.EFBIG, errno.ENOSPC, errno.EDQUOT])
def test_export_names_the_file_and_the_reason(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    def refuse(path: Path, *_: object, **__: object) -> None:
        raise OSError(code, os.strerror(code), str(path))

    monkeypatch.setattr(Path, "replace", refuse)
    with raises_code(InputError, "csv.not_written") as caught:
        export_csv(log, tmp_path / "out.csv")
    assert str(tmp_path / "out.csv") in str(caught.value)
    assert not list(tmp_path.glob("*out.csv"))


@pytest.mark.parametrize("command", ["export {log} -o {file}/e.csv", "design -o {file}/d.toml"])
def test_a_target_inside_a_file_is_refused(
    log: Path, tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file.csv"
    file.write_text("")
    assert run_app(command.format(log=log, file=file).split()) == 2
    error = capsys.readouterr().err
    assert str(file) in error
    assert "nternal error" not in error


def test_a_log_on_a_share_without_locks_is_read(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_locks(handle: int, *, shared: bool) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(files, "_lock", no_locks)
    assert being_written(log)
    assert open_log(log).facts().samples == 50
    os.utime(log, (0.0, 0.0))
    assert not being_written(log)


def test_unbuffered_output_stays_unbuffered() -> None:
    code = "import os\nfrom calstation.cli.process import prepare\nprepare()\nprint('line')\nos._exit(0)"
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    assert subprocess.check_output([sys.executable, "-c", code], env=environment, text=True) == "line\n"
