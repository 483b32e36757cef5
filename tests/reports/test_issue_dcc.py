"""`calstation report` embeds the digital calibration certificate, writes it to a separate file, and signs both."""

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from lxml import etree
from pyhanko.keys import load_certs_from_pemder_data
from pyhanko.pdf_utils.reader import PdfFileReader
from pyhanko.sign.validation import validate_pdf_signature
from pyhanko_certvalidator import ValidationContext
from signxml.xades.xades import XAdESVerifier

from calstation.cli.app import run_app
from calstation.config import (
    ReportSection,
)
from calstation.config.station_sections import SigningSection
from calstation.reports.signing import PASSWORD_VARIABLE
from calstation.results import load_result
from calstation.runs import closing
from tests.prepared import prepare_run
from tests.reports.dcc_reader import read_dcc
from tests.reports.seal import KEYS, PASSWORD, pem, write_certificate
from tests.shared_runs import SharedRuns
from tests.site_folder import SiteFolder


@pytest.fixture
def result_file(tmp_path: Path, shared_runs: SharedRuns) -> Path:
    """The result of a run with its log in the same folder."""
    path = Path(shared_runs.passed(tmp_path / "run", "six_position").result_file)
    content = json.loads(path.read_text(encoding="utf-8"))
    content["log"]["file"] = str(path.with_suffix(".h5"))
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.fixture
def seal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The signing certificate of the site."""
    monkeypatch.setenv(PASSWORD_VARIABLE, PASSWORD)
    return write_certificate(tmp_path / "seal.p12", KEYS["ec"]())


def attached(pdf: bytes) -> dict[str, Any]:
    """Return the attached files of a PDF by name."""
    names = list(PdfFileReader(io.BytesIO(pdf)).root["/Names"]["/EmbeddedFiles"]["/Names"])
    files = (entry.get_object()["/EF"]["/F"].data for entry in names[1::2])
    return dict(zip(map(str, names[::2]), files, strict=True))


@pytest.mark.long
def test_digital_certificate_is_in_the_pdf_and_in_a_separate_file(result_file: Path, tmp_path: Path) -> None:
    pdf, dcc = tmp_path / "report.pdf", tmp_path / "report.xml"
    command = ["report", str(result_file), "-o", str(pdf), "--dcc", str(dcc)]
    assert run_app(command) == 0
    written = pdf.read_bytes(), dcc.read_bytes()
    assert attached(written[0])[f"{result_file.stem}.xml"] == written[1]
    result = load_result(result_file)
    assert read_dcc(written[1]).values == {name: found.value for name, found in result.parameters.items()}
    assert run_app(command) == 0  # the same bytes again
    assert (pdf.read_bytes(), dcc.read_bytes()) == written


@pytest.mark.long
def test_pdf_and_certificate_are_signed(result_file: Path, tmp_path: Path, seal: Path) -> None:
    pdf, dcc = tmp_path / "report.pdf", tmp_path / "report.xml"
    assert run_app(["report", str(result_file), "-o", str(pdf), "--dcc", str(dcc), "--sign", str(seal)]) == 0
    XAdESVerifier().verify(dcc.read_bytes(), x509_cert=pem(seal))
    assert attached(pdf.read_bytes())[f"{result_file.stem}.xml"] == dcc.read_bytes()
    (signature,) = PdfFileReader(io.BytesIO(pdf.read_bytes())).embedded_signatures
    (root,) = load_certs_from_pemder_data(pem(seal))
    assert validate_pdf_signature(signature, ValidationContext(trust_roots=[root])).bottom_line
    assert etree.fromstring(dcc.read_bytes())[-1].tag.endswith("}Signature")


def test_unusable_signing_certificate_prevents_the_report(
    result_file: Path, tmp_path: Path, seal: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(PASSWORD_VARIABLE, "wrong")
    pdf = tmp_path / "report.pdf"
    assert run_app(["report", str(result_file), "-o", str(pdf), "--sign", str(seal)]) == 2
    assert "password" in capsys.readouterr().err
    assert not pdf.exists()


@pytest.mark.parametrize("option", ["--sign", "--templates"])
def test_missing_file_of_an_option_is_reported_with_the_option(
    result_file: Path, tmp_path: Path, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pdf, missing = tmp_path / "report.pdf", tmp_path / "missing.p12"
    assert run_app(["report", str(result_file), "-o", str(pdf), option, str(missing)]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert f"{missing}" in said
    assert "cannot be read: no such file or folder. Give a " in said
    assert f"that exists and can be read with {option} " in said
    assert "[report" not in said
    assert not pdf.exists()


def test_reports_of_a_station_with_a_certificate_are_signed(site_folder: SiteFolder) -> None:
    """A relative path refers to the folder of the station file."""
    setup = prepare_run(site_folder.request("six_position"))
    section = ReportSection(folder="reports", signing=SigningSection(certificate="keys/seal.p12"))
    signed = replace(setup, station=setup.station.model_copy(update={"report": section}))
    (site_folder.folder / "reports").mkdir()
    (site_folder.folder / "keys").mkdir()
    (site_folder.folder / "keys" / "seal.p12").touch()
    command = closing.report_command(signed, Path("SN-000042_1.json"), lambda _: None)
    assert command[-2:] == ["--sign", str(site_folder.folder / "keys" / "seal.p12")]
