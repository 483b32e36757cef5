"""`export --to` writes a calibration for another program, with its check beside it."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.conftest import META, Done, six_position_rows, write_log
from tests.results.test_history import write

Run = Callable[..., Done]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_log(tmp_path, six_position_rows(), meta=META.replace("accel_lsb = 1e-6", "accel_lsb = 1.001e-6"))


def test_result_is_exported_with_its_check(calstation: Run, log: Path, tmp_path: Path) -> None:
    result, out = tmp_path / "result.json", tmp_path / "imu.param"
    assert calstation("resolve", log, "--json", result).code == 0
    done = calstation("export", result, "--to", "ardupilot", "-o", out)
    assert done.code == 0, done.err
    assert "over 2400 samples" in done.err
    assert "cannot express" not in done.err
    factor = dict(line.split(",") for line in out.read_text(encoding="utf-8").splitlines()[1:])["INS_ACCSCAL_X"]
    assert float(factor) == pytest.approx(1 / 1.001, abs=3e-4)
    check = json.loads((tmp_path / "imu.param.check.json").read_text(encoding="utf-8"))
    assert (check["format"], check["samples"]) == ("ardupilot", 2400)


def test_log_without_a_result_is_solved_and_exported(calstation: Run, log: Path, tmp_path: Path) -> None:
    assert calstation("export", log, "--to", "c", "-o", tmp_path / "imu.h").code == 0
    assert json.loads((tmp_path / "imu.h.check.json").read_text(encoding="utf-8"))["not_expressed"] == []


def test_loss_beyond_the_limits_needs_an_option(calstation: Run, log: Path, tmp_path: Path) -> None:
    toml = log.with_suffix(".toml")
    limits = '[product]\nname = "unit"\n[product.limits.accel_scale]\nsigma_below = 1e-9\n'
    toml.write_text(toml.read_text(encoding="utf-8") + limits, encoding="utf-8")
    arguments = ("export", log, "--to", "gazebo", "-o", tmp_path / "imu.sdf")
    done = calstation(*arguments)
    assert done.code == 2
    assert "gazebo cannot express accel_scale_x" in done.err
    assert not (tmp_path / "imu.sdf").exists()
    done = calstation(*arguments, "--allow-loss")
    assert done.code == 0
    shown = " ".join(done.err.split())
    assert re.search(r"gazebo cannot express accel_scale_x \(1\.\de\+06 times the limit\), accel_scale_y", shown)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--to", "kalibre"), "Choose from kalibr"),
        (("--allow-loss",), "Add --to"),
        (("--to", "ros", "--log", "absent.h5"), "absent.h5"),
    ],
)
def test_wrong_options_are_refused(
    calstation: Run, log: Path, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    done = calstation("export", log, *options, "-o", tmp_path / "imu.yaml")
    assert done.code == 2
    assert words in done.err
    assert done.err.count("\n") == 1


def test_folder_of_runs_is_exported_as_a_table(calstation: Run, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    write(runs, "a", "SN-1", "passed", 1, values={"gyro_bias_x": 0.25})
    done = calstation("export", runs, "-o", tmp_path / "runs.csv")
    assert (done.code, done.err) == (0, f"{tmp_path / 'runs.csv'}: 1 run\n")
    assert "0.25" in (tmp_path / "runs.csv").read_text(encoding="utf-8")
