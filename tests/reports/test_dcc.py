"""A digital calibration certificate meets PTB's schema and rules, and its numbers are read back unchanged."""

import math
from collections.abc import Mapping
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from dsi_unit import DsiUnit
from lxml import etree

from calstation.messages import Text
from calstation.physics import EFFECT_PARAMETERS, PAIR_PARAMETERS, PARAMETERS
from calstation.records import InstrumentSection, LaboratorySection, open_log
from calstation.reports import Certificate, build_certificate, write_dcc
from calstation.reports.dsi import dsi_unit, joint_list
from calstation.reports.signing import PASSWORD_VARIABLE, load_signer, sign_xml
from calstation.results import load_result, resolve
from calstation.sequencer import Finalized
from calstation.simulation import make_recording
from tests.reports.dcc_reader import broken_rules, find, read_dcc, schema
from tests.reports.seal import KEYS, PASSWORD, write_certificate
from tests.shared_runs import SharedRuns
from tests.site_folder import SiteFolder

pytestmark = pytest.mark.long

LABORATORY = LaboratorySection(
    name="惯性实验室",
    address="No. 1, Lab Street",
    country="CN",
    place="Hall 3",
    accreditation="CNAS L0001",
    customer="Pilots & Sons <Ltd>",
    customer_address="Airfield",
    signatories=["A. Weber, Head of laboratory", "李娜"],
)
TABLE = InstrumentSection(
    name="Rate table",
    serial="T-7",
    kind="table",
    certificate="K-1",
    calibrated=date(2026, 1, 5),
    due=date(2027, 1, 5),
)


def certified(ended: Finalized) -> Certificate:
    """Return the certificate of a run at a laboratory."""
    found = build_certificate(load_result(Path(ended.result_file)), open_log(Path(ended.log)).meta)
    return replace(found, laboratory=LABORATORY, instruments=(TABLE, InstrumentSection(name="Survey")))


def failed_run(site: SiteFolder) -> Finalized:
    """A run of a unit outside its limits."""
    site.write(out_of_limits=True)
    return site.run("six_position")


@pytest.fixture(scope="module")
def certificates(shared_runs: SharedRuns, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Certificate]:
    """Certificates of all types."""
    folder = tmp_path_factory.mktemp("certificates")
    found = {
        "passed": certified(shared_runs.passed(folder / "passed")),
        "failed": certified(shared_runs.copy("failed", folder / "failed", failed_run)),
        "partial": certified(shared_runs.passed(folder / "partial", "six_position")),
    }
    for kind in ("hand", "pair", "gimbal"):
        path = folder / f"{kind}.h5"
        make_recording(kind, path)
        solved = resolve(path)
        found[kind] = replace(
            build_certificate(solved.result, open_log(path).meta, issued=date(2026, 11, 23)), laboratory=LABORATORY
        )
    return found


def test_every_certificate_is_valid_by_the_schema(
    certificates: Mapping[str, Certificate], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one test, so that one process downloads the schema."""
    monkeypatch.setenv(PASSWORD_VARIABLE, PASSWORD)
    signer = load_signer(write_certificate(tmp_path / "seal.p12", KEYS["ec"]()))
    plain = replace(certificates["passed"], laboratory=None, instruments=())
    revised = replace(certificates["passed"], revision=2, supersedes="X-R1, 2026-11-22", reason="typing error")
    for name, certificate in {**certificates, "plain": plain, "revised": revised}.items():
        xml = write_dcc(certificate)
        for written in (xml, sign_xml(xml, signer)):
            schema().validate(etree.fromstring(written))
            assert not list(schema().error_log), name


@pytest.mark.parametrize("kind", ["passed", "failed", "partial", "hand", "pair", "gimbal"])
def test_every_certificate_is_valid_by_the_schematron_rules(certificates: Mapping[str, Certificate], kind: str) -> None:
    assert broken_rules(write_dcc(certificates[kind])) == []


@pytest.mark.parametrize("kind", ["passed", "failed", "partial", "hand", "pair", "gimbal"])
def test_numbers_are_read_back_unchanged(certificates: Mapping[str, Certificate], kind: str) -> None:
    certificate = certificates[kind]
    read = read_dcc(write_dcc(certificate))
    rows = certificate.quantities
    assert rows
    assert read.values == {row.name: row.value for row in rows}
    assert read.expanded == {row.name: 2.0 * row.sigma for row in rows}
    assert read.units == {row.name: dsi_unit(row.unit) for row in rows}
    if kind == "pair":  # its result has no correlation
        assert read.names == []
    else:
        sigmas = np.array([row.sigma for row in rows])
        assert read.names == [row.name for row in rows]
        assert np.array_equal(read.covariance, certificate.correlation * np.outer(sigmas, sigmas))
    assert read.as_found == {row.name: row.as_found for row in rows if row.as_found is not None}
    assert read.as_left == {row.name: row.as_left for row in rows if row.as_left is not None}


def test_covariance_equals_the_result(certificates: Mapping[str, Certificate]) -> None:
    """It is compared with the result JSON, not only with the certificate object."""
    result = certificates["passed"].result.to_json()
    read = read_dcc(write_dcc(certificates["passed"]))
    at = {name: k for k, name in enumerate(read.names)}
    pairs = [(a, b, rho) for a, row in result["correlation"].items() for b, rho in row.items()]
    assert len(pairs) > 100
    for a, b, rho in pairs:
        expected = rho * result["parameters"][a]["sigma"] * result["parameters"][b]["sigma"]
        assert read.covariance[at[a], at[b]] == read.covariance[at[b], at[a]] == pytest.approx(expected, rel=1e-14)


def test_certificate_of_a_passed_unit_states_an_adjustment(certificates: Mapping[str, Certificate]) -> None:
    read = read_dcc(write_dcc(certificates["passed"]))
    assert abs(read.as_left["gyro_scale_x"]) < read.expanded["gyro_scale_x"] < abs(read.as_found["gyro_scale_x"])


def test_same_certificate_gives_the_same_bytes(certificates: Mapping[str, Certificate]) -> None:
    first, again = write_dcc(certificates["passed"]), write_dcc(replace(certificates["passed"]))
    assert first == again
    assert first.startswith(b"<?xml")


@pytest.mark.parametrize(
    ("kind", "stated"), [("passed", ["pass"]), ("failed", ["fail"]), ("partial", []), ("hand", [])]
)
def test_only_a_full_calibration_states_conformity(
    certificates: Mapping[str, Certificate], kind: str, stated: list[str]
) -> None:
    """A passed partial calibration is not a statement about the unit."""
    root = etree.fromstring(write_dcc(certificates[kind]))
    assert [element.text for element in find(root, "//dcc:statement/dcc:conformity")] == stated


def test_certificate_with_unjudged_limits_states_no_conformity_of_the_whole_unit(
    certificates: Mapping[str, Certificate],
) -> None:
    passed = certificates["passed"]
    names = [f"gyro_bias_{axis}" for axis in "xyz"]
    unjudged = replace(passed, result=passed.result.model_copy(update={"not_compared": names}))
    xml = write_dcc(unjudged)
    root = etree.fromstring(xml)
    assert find(root, "//dcc:statement/dcc:conformity") == []
    stated = find(root, "//dcc:statement[dcc:reference='7.8.6']/dcc:declaration/dcc:content")
    assert "Not judged although they have a limit: gyro bias." in stated[0].text
    assert "有限差但未判定：陀螺零偏" in stated[1].text
    assert broken_rules(xml) == []


def test_failed_quantity_is_reported(certificates: Mapping[str, Certificate]) -> None:
    decisions = read_dcc(write_dcc(certificates["failed"])).decisions
    assert [name for name, decision in decisions.items() if decision == "fail"] == ["accel_scale_y"]


def test_only_an_authenticated_person_is_the_main_signer(certificates: Mapping[str, Certificate]) -> None:
    root = etree.fromstring(write_dcc(replace(certificates["passed"], authorised=("Wang Wei", "李娜"))))
    people = find(root, "//dcc:respPerson")
    names = [find(person, "dcc:person/dcc:name/dcc:content")[0].text for person in people]
    assert names == ["Wang Wei", "李娜", "A. Weber", "李娜"]
    assert [bool(find(person, "dcc:mainSigner")) for person in people] == [True, False, False, False]


def test_laboratory_instruments_and_revision_have_their_elements(certificates: Mapping[str, Certificate]) -> None:
    revised = replace(certificates["passed"], revision=1, supersedes="X, 2026-11-22", reason="typing error")
    root = etree.fromstring(write_dcc(revised))

    def text(path: str) -> list[str]:
        return [element.text for element in find(root, path)]

    assert text("//dcc:countryCodeISO3166_1") == ["CN"]
    assert text("//dcc:uniqueIdentifier") == [f"{revised.number}-R1"]
    (replaced,) = text("//dcc:statement[dcc:name/dcc:content='Superseded certificate']/dcc:declaration/dcc:content")
    assert revised.supersedes in replaced
    assert text("//dcc:customer/dcc:name/dcc:content") == ["Pilots & Sons <Ltd>"]
    assert text("//dcc:respPerson/dcc:role") == ["Head of laboratory"]
    assert text("//dcc:respPerson//dcc:content") == ["A. Weber", "李娜"]
    assert not text("//dcc:mainSigner"), "nobody has proved that he signs"
    assert text("//dcc:item//dcc:value") == [revised.result.serial]
    assert text("//dcc:measuringEquipment//dcc:value") == ["T-7", "K-1"]
    assert revised.result.log.sha256 in text("//dcc:coreData//dcc:value")
    assert text("//dcc:influenceCondition//si:real/si:unit")[-1] == r"\metre\second\tothe{-2}"


def test_deviations_are_stated_in_both_languages(certificates: Mapping[str, Certificate]) -> None:
    xml = write_dcc(certificates["passed"], [Text("certificate.d_no_table"), Text.of("certificate.d_gaps", count=2)])
    declared = find(etree.fromstring(xml), "//dcc:statement[dcc:reference='7.8.2.1 n)']/dcc:declaration/dcc:content")
    assert [content.get("lang") for content in declared] == ["en", "zh", "en", "zh"]
    assert declared[2].text.startswith("The recording has 2 gaps")
    assert broken_rules(xml) == []


def test_unknown_laboratory_data_are_marked_as_not_stated(certificates: Mapping[str, Certificate]) -> None:
    """ZZ is a user-assigned ISO 3166-1 code, commonly used for an unknown country."""
    root = etree.fromstring(write_dcc(replace(certificates["hand"], laboratory=None)))
    assert [e.text for e in find(root, "//dcc:countryCodeISO3166_1")] == ["ZZ"]
    assert [e.text for e in find(root, "//dcc:customer/dcc:name/dcc:content")] == ["Not stated", "未注明"]


def test_non_finite_number_is_written_without_a_value(certificates: Mapping[str, Certificate]) -> None:
    certificate = certificates["partial"]
    lost = replace(certificate.quantities[0], sigma=math.inf, unobservable=True)
    xml = write_dcc(replace(certificate, quantities=(lost, *certificate.quantities[1:])))
    assert math.isnan(read_dcc(xml).expanded[lost.name])
    assert broken_rules(xml) == []


@pytest.mark.parametrize(
    ("units", "expected"),
    [
        (("rad/s",), r"\radian\second\tothe{-1}"),
        (("1", "1"), r"\one"),
        (("s²/m", "m/s²"), r"\one"),
        (("s⁴/m²",), r"\metre\tothe{-2}\second\tothe{4}"),
        (("rad·s/m", "rad/s"), r"\metre\tothe{-1}\radian\tothe{2}"),
    ],
)
def test_products_of_units_are_simplified(units: tuple[str, ...], expected: str) -> None:
    assert dsi_unit(*units) == expected


@pytest.mark.filterwarnings("ignore:The dsi string contains the token")  # of the parser's own table
@pytest.mark.parametrize("unit", sorted({p.unit for p in (*PARAMETERS, *EFFECT_PARAMETERS, *PAIR_PARAMETERS)}))
def test_ptb_parser_accepts_every_unit(unit: str) -> None:
    assert DsiUnit(dsi_unit(unit)).warnings == []
    assert DsiUnit(dsi_unit(unit, "rad/s")).warnings == []


@pytest.mark.parametrize(
    ("variances", "factor"),
    [
        ([4.0], 1.959964),
        ([4.0, 9.0], math.sqrt(-2.0 * math.log(0.05))),  # chi-squared with 2 degrees of freedom is exponential
        ([4.0, 9.0, 0.0], math.sqrt(-2.0 * math.log(0.05))),  # a fixed quantity adds no dimension
    ],
)
def test_coverage_factor_matches_the_coverage_probability(variances: list[float], factor: float) -> None:
    names = [f"q{k}" for k in range(len(variances))]
    element = joint_list(names, ["m"] * len(names), variances, np.diag(variances))
    (written,) = find(element, ".//si:ellipsoidalRegion/si:coverageFactor")
    assert float(written.text) == pytest.approx(factor, abs=5e-5)
