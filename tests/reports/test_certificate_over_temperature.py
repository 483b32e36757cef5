"""The certificate of a unit over temperature: table, curves and statement, and coefficients that a program reads."""

import io
from dataclasses import replace
from datetime import date

import numpy as np
import pypdf
import pytest

from calstation.judgement import Check
from calstation.messages import Language
from calstation.physics import NAMES, display
from calstation.reports import Certificate, build_certificate, write_dcc
from calstation.reports.analysis import Analysis
from calstation.reports.budget import Budget
from calstation.reports.deviations import not_included
from calstation.reports.document import document
from calstation.reports.issue import attachments
from calstation.reports.pdf import typeset
from tests.reports.dcc_reader import broken_rules, read_coefficients, read_dcc
from tests.thermal_results import thermal_meta, thermal_result


@pytest.fixture(scope="module")
def certificate() -> Certificate:
    return build_certificate(thermal_result(), thermal_meta(), issued=date(2026, 11, 28))


@pytest.fixture(scope="module")
def analysis() -> Analysis:
    sigma = np.ones((2, len(NAMES)))
    spans = {"temperature": (0.0, 600.0)}
    return Analysis(np.array([0.0, 600.0]), sigma, spans, {}, sigma[0], sigma[1], Budget({}, {}), True, 0, None, (), {})


def test_table_contains_both_ends_the_reference_and_the_worst_value(
    certificate: Certificate, analysis: Analysis
) -> None:
    result = certificate.result
    over = document(certificate, analysis, "en")["over"]
    assert list(over["ends"].values()) == ["−40 °C", "25 °C", "85 °C"]
    group = over["groups"][0]
    assert (group["name"], group["unit"]) == ("Gyro bias", "°/h")
    row = group["rows"][1]
    values, sigmas = result.curve("gyro_bias_y", np.array([-40.0, 25.0, 85.0]))
    worst, at = result.worst("gyro_bias_y")
    shown = [[float(text.replace("−", "-")) for text in cell.split(" ± ")] for cell in row["cells"]]
    expected = [*zip(values, sigmas, strict=True), (worst.value, worst.sigma)]
    for (value, expanded), (true, sigma) in zip(shown, expected, strict=True):
        assert value == pytest.approx(display("gyro_bias_y", true)[0], abs=0.5 * expanded)
        assert expanded == pytest.approx(2.0 * display("gyro_bias_y", sigma)[0], rel=0.06)
    assert float(row["at"].replace("−", "-")) == pytest.approx(at, abs=0.5)
    assert {group["name"] for group in over["groups"]} == {
        *("Gyro bias", "Gyro scale factor", "Accel bias", "Accel scale factor")
    }


@pytest.mark.parametrize(
    ("language", "words"),
    [
        ("en", ("outsidethisrange,nothingisclaimed", "Overtemperature", "Coefficients", "−40°C")),
        ("zh_CN", ("对该范围之外不作任何声明", "温度特性", "系数", "−40°C")),
    ],
)
def test_document_states_the_range_and_shows_the_section(
    certificate: Certificate, analysis: Analysis, language: Language, words: tuple[str, ...]
) -> None:
    content = typeset(certificate, analysis, language, attachments(certificate))
    text = "".join("".join(page.extract_text().split()) for page in pypdf.PdfReader(io.BytesIO(content)).pages)
    for word in words:
        assert word in text
    assert "n_over_temperature" in {t.code.rpartition(".")[2] for t in not_included(certificate, analysis)}


def test_effects_that_were_tested_at_every_temperature_are_not_called_untested(
    certificate: Certificate, analysis: Analysis
) -> None:
    effects = Check("effects", "temperature", 5.0, 30.0, "1", passed=True)
    tested = certificate.result.model_copy(update={"checks": [*certificate.result.checks, effects]})
    codes = [t.code for t in not_included(replace(certificate, result=tested), replace(analysis, effects_tested=False))]
    assert "certificate.n_effects_tested" in codes


def test_coefficients_and_their_covariance_are_read_back(certificate: Certificate) -> None:
    result, xml = certificate.result, write_dcc(certificate)
    found = read_coefficients(xml)
    assert found.temperatures == [25.0, -40.0, 85.0]
    assert found.units["gyro_bias_x[0]"] == r"\radian\second\tothe{-1}"
    assert found.units["gyro_bias_x[2]"] == "".join((r"\kelvin\tothe{-2}", r"\radian", r"\second\tothe{-1}"))
    assert found.units["gyro_bias_x[rate]"] == "".join((r"\kelvin\tothe{-1}", r"\radian"))
    assert found.values["gyro_bias_x[3]"] == result.temperature.coefficients["gyro_bias_x"].values[3]
    np.testing.assert_array_equal(found.covariance, np.array(result.temperature.covariance))
    for name in ("gyro_bias_x", "accel_scale_z", "gyro_misalign_xy"):
        for temperature in (-40.0, 3.0, 85.0):
            (value,), (sigma,) = result.curve(name, np.array([temperature]))
            assert found.parameter(name, temperature) == (
                pytest.approx(value, rel=1e-9),
                pytest.approx(sigma, rel=1e-6),
            )


@pytest.mark.long
def test_joint_covariance_at_the_reference_is_kept_apart(certificate: Certificate) -> None:
    xml = write_dcc(certificate)
    reading = read_dcc(xml)
    assert reading.covariance.shape == (30, 30)
    k = reading.names.index("gyro_bias_x")
    assert np.sqrt(reading.covariance[k, k]) == pytest.approx(certificate.result.parameters["gyro_bias_x"].sigma)
    assert "nothing is claimed" in xml.decode()
    assert [rule for rule in broken_rules(xml) if "ISO3166" not in rule] == []  # the laboratory is not stated
