"""`calstation design` writes a product and JSON, and rejects wrong usage."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from calstation.config import check
from calstation.designer.stages import ShorterStages


@pytest.mark.long
def test_product_with_the_shortest_schedule_is_written_and_shown(calstation, tmp_path: Path) -> None:
    out, answer = tmp_path / "fast.toml", tmp_path / "answer.json"
    done = calstation("design", "--product", "mems_c", "--time-limit", "1", "-o", out, "--json", answer)
    assert done.code == 0, done.err
    found = json.loads(answer.read_text(encoding="utf-8"))
    written = out.read_text(encoding="utf-8")
    assert check("products", written) == []
    assert tomllib.loads(written)["schedule"]["designed"]["moves"] == found["moves"]
    assert found["worst_sigma_over_limit"] <= 0.801
    assert found["duration_s"] < found["default_duration_s"]
    for words in ("The current stages take", "noise, 1.5 times the profile's", "accel_cubic", str(out)):
        assert words in done.out


@pytest.mark.long
def test_product_with_the_shortest_schedule_over_temperature_is_written_and_shown(calstation, tmp_path: Path) -> None:
    out, answer = tmp_path / "thermal.toml", tmp_path / "answer.json"
    options = ("--station", "virtual_chamber", "--time-constant", "270", "--self-heating", "4")
    done = calstation("design", "--product", "mems_c_thermal", *options, "-o", out, "--json", answer)
    assert done.code == 0, done.err
    found = json.loads(answer.read_text(encoding="utf-8"))
    written = out.read_text(encoding="utf-8")
    assert check("products", written) == []
    assert tomllib.loads(written)["schedule"]["temperature"]["points_c"] == found["soak"]["points_c"]
    for words in ("min of chamber time", "270 s", "two temperatures more", "ramp", "accel_quadratic", str(out)):
        assert words in done.out


@pytest.mark.parametrize(("undetermined", "code"), [((), 0), (("accel_quadratic_x",), 1)])
def test_shorter_stages_that_leave_a_parameter_undetermined_are_said_to_fail(
    calstation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, undetermined: tuple[str, ...], code: int
) -> None:
    found = ShorterStages(np.full(30, 0.5), np.ones(30), {}, 60.0, 90.0, None, 1.0, undetermined)
    monkeypatch.setattr("calstation.cli.commands.design.shorten_stages", lambda report, request: found)
    done = calstation("design", "--product", "mems_c", "--keep-stages", "-o", tmp_path / "short.toml")
    assert done.code == code, done.err
    assert ("its data do not determine accel_quadratic_x" in done.out) is bool(undetermined)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--margin", "2"), "--margin"),
        (("-o", "nowhere/fast.toml"), "cannot be written"),
        (("--station", "virtual_hand"), "table"),
        (("--time-constant", "300"), "[temperature]"),
        (("--product", "mems_c_thermal", "--station", "virtual_chamber", "--duration", "300"), "--duration"),
        (("--product", "mems_c_thermal"), "chamber"),
    ],
)
def test_wrong_usage_is_refused(calstation, tmp_path: Path, options: tuple[str, ...], words: str) -> None:
    done = calstation("design", "-o", tmp_path / "fast.toml", *options)
    assert done.code == 2
    assert words in done.err
