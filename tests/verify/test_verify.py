"""The second opinion imports nothing of the product, agrees with it on a sound log, and finds planted errors."""

import ast
import copy
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import calstation.verify
from calstation.cli.app import run_app
from calstation.records import open_log
from calstation.reports import build_certificate, write_dcc
from calstation.results import load_result
from calstation.verify import samples, verify
from tests.shared_runs import SharedRuns

FOLDER = Path(calstation.verify.__file__).parent
ALLOWED = {"numpy", "scipy", "h5py"}


@pytest.fixture(scope="module")
def run(shared_runs: SharedRuns, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result JSON of a run of all stages, beside its log."""
    return Path(shared_runs.passed(tmp_path_factory.mktemp("verify")).result_file)


@pytest.fixture(scope="module")
def solution(run: Path) -> Any:
    log, result = samples.read_log(run.with_suffix(".h5")), json.loads(run.read_text(encoding="utf-8"))
    return verify.Solution(log, result)


@pytest.fixture
def solved_once(solution: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verify, "Solution", lambda *_: solution)


def copied(run: Path, folder: Path, change: Callable[[dict[str, Any]], None] = lambda _: None) -> Path:
    """Copy log and result to a folder, and change the result."""
    shutil.copy(run.with_suffix(".h5"), folder / run.with_suffix(".h5").name)
    result = json.loads(run.read_text(encoding="utf-8"))
    change(result)
    target = folder / run.name
    target.write_text(json.dumps(result), encoding="utf-8")
    return target


def codes(source: Path) -> set[str]:
    return {finding["code"] for finding in verify.verify(source)["findings"]}


def test_nothing_of_the_product_is_imported() -> None:
    for file in FOLDER.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) and not node.level else []
            for name in names:
                package = name.partition(".")[0]
                assert package in ALLOWED | sys.stdlib_module_names, f"{file.name} imports {name}"


def test_an_auditor_can_read_the_program() -> None:
    lines = {file.name: len(file.read_text(encoding="utf-8").splitlines()) for file in FOLDER.glob("*.py")}
    assert sum(lines.values()) < 1_020
    assert lines["temperature.py"] < 200


@pytest.mark.long  # starts a process that loads scipy
def test_a_copy_of_the_folder_runs_alone(tmp_path: Path) -> None:
    shutil.copytree(FOLDER, tmp_path / "opinion", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "broken.h5").write_bytes(b"no log")
    command = [sys.executable, "-m", "opinion", "broken.h5"]
    done = subprocess.run(command, cwd=tmp_path, env={}, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert "broken.h5 cannot be read" in done.stderr


def test_values_sigmas_and_correlations_agree(run: Path, solution: Any) -> None:
    result = load_result(run)
    for name, parameter in result.parameters.items():
        i = verify.NAMES.index(name)
        assert abs(parameter.value - solution.mean[i]) < 0.03 * parameter.sigma, name
        assert parameter.sigma == pytest.approx(solution.sigma[i], rel=5e-3), name


@pytest.mark.usefixtures("solved_once")
def test_a_sound_run_agrees_by_log_result_and_certificate(run: Path, tmp_path: Path) -> None:
    result = copied(run, tmp_path)
    certificate = build_certificate(load_result(result), open_log(result.with_suffix(".h5")).meta)
    dcc = result.with_suffix(".xml")
    dcc.write_bytes(write_dcc(certificate))
    for source in (result.with_suffix(".h5"), result, dcc):
        report = verify.verify(source)
        assert report["findings"] == [], source
        assert report["verdict"] == {"stated": "pass", "limits": "pass"}
        assert len(report["parameters"]) == 30


def test_a_value_that_no_stage_determines_is_found(
    run: Path, tmp_path: Path, solution: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    partial = copy.copy(solution)
    partial.stage = {i: stage for i, stage in solution.stage.items() if verify.NAMES[i] != "inner_lever_z"}
    monkeypatch.setattr(verify, "Solution", lambda *_: partial)
    assert codes(copied(run, tmp_path)) == {"unfounded"}


def _sign(result: dict[str, Any]) -> None:
    result["parameters"]["gyro_misalign_xy"]["value"] *= -1.0


def _swapped(result: dict[str, Any]) -> None:
    rows = result["parameters"]
    rows["accel_bias_x"]["value"], rows["accel_bias_y"]["value"] = (
        rows["accel_bias_y"]["value"],
        rows["accel_bias_x"]["value"],
    )


def _shifted(result: dict[str, Any]) -> None:
    row = result["parameters"]["gyro_scale_z"]
    row["value"] += 0.2 * row["sigma"]


def _sigma(result: dict[str, Any]) -> None:
    result["parameters"]["accel_quadratic_y"]["sigma"] *= 0.95


def _correlation(result: dict[str, Any]) -> None:
    rows = [(a, b) for a, row in result["correlation"].items() for b, value in row.items() if abs(value) > 0.3]
    one, other = rows[0]
    result["correlation"][one][other] *= -1.0


def _missing(result: dict[str, Any]) -> None:
    del result["parameters"]["inner_lever_z"]


def _verdict(result: dict[str, Any]) -> None:
    result["passed"], result["outcome"] = False, "failed"


def _hidden(result: dict[str, Any]) -> None:
    next(check for check in result["checks"] if check["kind"] == "effects")["passed"] = False


def _decision(result: dict[str, Any]) -> None:
    next(check for check in result["checks"] if check["kind"] == "within")["passed"] = False
    result["passed"], result["outcome"] = False, "failed"


def _digest(result: dict[str, Any]) -> None:
    result["log"]["sha256"] = "0" * 64


def _configuration(result: dict[str, Any]) -> None:
    result["configuration_sha256"] = "0" * 64


def _serial(result: dict[str, Any]) -> None:
    result["unit"]["serial"] = "SN-999999"


@pytest.mark.usefixtures("solved_once")
@pytest.mark.parametrize(
    ("change", "code"),
    [
        (_sign, "value"),
        (_swapped, "value"),
        (_shifted, "value"),
        (_sigma, "sigma"),
        (_correlation, "correlation"),
        (_missing, "missing"),
        (_verdict, "verdict"),
        (_hidden, "verdict"),
        (_decision, "decision"),
        (_digest, "digest"),
        (_configuration, "digest"),
        (_serial, "serial"),
    ],
)
def test_an_error_planted_in_a_result_is_found(
    run: Path, tmp_path: Path, change: Callable[[dict[str, Any]], None], code: str
) -> None:
    assert code in codes(copied(run, tmp_path, change))


@pytest.mark.usefixtures("solved_once")
def test_an_error_planted_in_a_digital_certificate_is_found(run: Path, tmp_path: Path) -> None:
    result = copied(run, tmp_path)
    certificate = build_certificate(load_result(result), open_log(result.with_suffix(".h5")).meta)
    text, dcc = write_dcc(certificate).decode(), result.with_suffix(".xml")
    value = repr(load_result(result).parameters["gyro_scale_x"].value)
    assert value in text
    for planted, found in (
        (text.replace("conformity>pass<", "conformity>fail<"), "verdict"),
        (text.replace("XMLList>pass pass pass<", "XMLList>pass fail pass<"), "decision"),
        (text.replace(value, repr(1.01 * float(value))), "value"),
    ):
        dcc.write_text(planted, encoding="utf-8")
        assert found in codes(dcc)


@pytest.mark.usefixtures("solved_once")
def test_a_partial_run_is_no_pass(run: Path, tmp_path: Path) -> None:
    result = copied(run, tmp_path)
    certificate = build_certificate(load_result(result), open_log(result.with_suffix(".h5")).meta)
    result.with_suffix(".xml").write_bytes(write_dcc(certificate))
    assert codes(result.with_suffix(".xml")) == set()
    with h5py.File(result.with_suffix(".h5"), "r+") as file:  # the result that the log contains is a partial one
        line = json.loads(bytes(file["results"][:]))
        data = np.frombuffer((json.dumps({**line, "partial": True}) + "\n").encode(), np.uint8)
        file["results"].resize((len(data),))
        file["results"][:] = data
    assert codes(result.with_suffix(".xml")) == {"verdict"}


@pytest.mark.usefixtures("solved_once")
def test_a_changed_sample_is_found(run: Path, tmp_path: Path) -> None:
    path = copied(run, tmp_path).with_suffix(".h5")
    with h5py.File(path, "r+") as file:
        rows = file["samples"][100:101]
        rows["counts"][0, 2] += 1.0
        file["samples"][100:101] = rows
    assert [f["subject"] for f in verify.verify(path)["findings"]] == ["log", "log"]


@pytest.mark.parametrize("name", ["meta", "stages", "samples", "results"])
@pytest.mark.parametrize("value", [0.0, "text", np.zeros((2, 2)), np.zeros(3, np.complex128), None])
def test_a_log_of_another_structure_cannot_be_read(run: Path, tmp_path: Path, name: str, value: Any) -> None:
    path = copied(run, tmp_path).with_suffix(".h5")
    with h5py.File(path, "r+") as file:
        del file[name]
        if value is None:
            file.create_dataset(name, (2**40,), np.uint8, chunks=(8192,))  # a terabyte that is not there
        else:
            file[name] = value
    with pytest.raises(samples.UnreadableError, match=name):
        samples.read_log(path)


@pytest.mark.parametrize(
    "text", ["", "{}", "[" * 100_000, '{"unit": 3}', "<a/>", "%PDF-1.7", "<!DOCTYPE a><a/>", "{unit"]
)
def test_a_damaged_certificate_cannot_be_read(tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "certificate.pdf"
    source.write_text(text, encoding="utf-8")
    assert run_app(["verify", str(source)]) == 2
    assert "certificate.pdf" in capsys.readouterr().err


@pytest.mark.parametrize("change", [{"log": {"first_seq": "x"}}, {"stages": 3}, {"checks": [{"kind": "imu_noise"}]}])
def test_a_result_with_entries_of_another_kind_cannot_be_read(
    run: Path, tmp_path: Path, change: dict[str, Any]
) -> None:
    assert run_app(["verify", str(copied(run, tmp_path, lambda result: result.update(change)))]) == 2


@pytest.mark.usefixtures("solved_once")
def test_log_in_the_folder_of_the_runs_beside_that_of_the_certificates_is_found(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    runs, certificates = tmp_path / "runs", tmp_path / "certificates"
    runs.mkdir()
    certificates.mkdir()
    source = copied(run, runs, lambda result: result["log"].update(file=run.with_suffix(".h5").name))
    moved = source.rename(certificates / source.name)
    monkeypatch.chdir(certificates)
    assert not codes(Path(moved.name))
    (runs / source.with_suffix(".h5").name).unlink()
    assert run_app(["verify", str(moved)]) == 2
    assert "is not beside it or its folder; give it by --log" in capsys.readouterr().err


def test_a_method_that_is_not_covered_is_refused(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = copied(run, tmp_path, lambda result: result.update(stages=["gimbal"]))
    assert run_app(["verify", str(source)]) == verify.NOT_COVERED
    assert capsys.readouterr() == ("", "verify: This program does not cover the method gimbal.\n")


@pytest.mark.long
def test_the_attachments_of_a_pdf_are_verified(run: Path, tmp_path: Path) -> None:
    result, pdf = copied(run, tmp_path), tmp_path / "certificate.pdf"
    assert run_app(["report", str(result), "-o", str(pdf)]) == 0
    assert run_app(["verify", str(pdf), "--log", str(result.with_suffix(".h5"))]) == 0


@pytest.mark.exhaustive
def test_a_log_with_a_gap_agrees(run: Path, tmp_path: Path) -> None:
    log, result = copied(run, tmp_path).with_suffix(".h5"), tmp_path / "gap.json"
    with h5py.File(log, "r+") as file:
        rows, stage = file["samples"][:], [*file["stages"][:]].index(b"excitation")
        middle = int(np.median(np.flatnonzero(rows["stage"] == stage)))
        rows = np.delete(rows, slice(middle, middle + 37))
        file["samples"].resize((len(rows),))
        file["samples"][:] = rows
    digest = samples.read_log(log).digests["log"]
    with h5py.File(log, "r+") as file:
        line = np.frombuffer((json.dumps({"outcome": "passed", "sha256": digest}) + "\n").encode(), np.uint8)
        file["closing"].resize((len(line),))
        file["closing"][:] = line
    assert run_app(["resolve", str(log), "--json", str(result)]) in (0, 1)
    assert run_app(["verify", str(result), "--log", str(log)]) == 0
