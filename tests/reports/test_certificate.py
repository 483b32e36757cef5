"""Certificates of every type of run: content, PDF/A conformance and text, in English and Chinese.

Typst writes PDF/A-3b and refuses content forbidden by the standard. veraPDF, which would validate the file as a
whole, is not available in PyPI, npm or Debian. The tests check what a reader of the
file can see: identification in the XMP metadata, output intent, attachments, embedded fonts.
"""

import io
import json
import re
import tomllib
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pypdf
import pytest
import tomli_w
from helpers import sampled

from calstation.config import RunRequest
from calstation.config.library import shipped_folder
from calstation.devices.profiles import PROTOCOLS
from calstation.errors import InputError
from calstation.estimation import Diagnosis
from calstation.judgement import Check
from calstation.messages import Language, catalogue, parameter_name, sentence
from calstation.physics import INDEX, RATE, display
from calstation.records import PriorSection, context_from_meta, open_log
from calstation.records.meta import SecondaryImuSection
from calstation.reports import ReportRequest, build_certificate, issue_report, write_dcc
from calstation.reports.analysis import Analysis, _SigmaRecorder
from calstation.reports.budget import LATITUDE_ERROR_DEG
from calstation.reports.content import arrangement, unit_registers
from calstation.reports.deviations import deviations, not_included
from calstation.reports.document import document
from calstation.reports.issue import attachments
from calstation.reports.numbers import exact
from calstation.reports.pdf import typeset
from calstation.reports.source import load_source
from calstation.results import Result, resolve
from calstation.runs import execute
from calstation.sequencer import Control, Event, Finalized
from calstation.simulation import make_recording
from tests.helpers import ignore_progress
from tests.reports.certificates import KINDS, LABORATORY, Made, make
from tests.reports.test_fonts import RARE, fonts_of, write_font
from tests.shared_runs import SharedRuns

LANGUAGES: tuple[Language, ...] = ("en", "zh_CN")
#: Verdicts in both languages.
VERDICTS = {
    "passed": ("PASS", "合格"),
    "partial": ("PARTIAL", "部分校准"),
    "failed": ("FAIL", "不合格"),
}


#: The kinds of runs; those of the full table take long.
CASES = [pytest.param(kind, marks=[pytest.mark.long] if kind != "gimbal" else []) for kind in KINDS]


@pytest.fixture
def made(shared_runs: SharedRuns, tmp_path: Path, request: pytest.FixtureRequest) -> Made:
    return make(shared_runs, tmp_path / "site", request.param)


def printed(made: Made, language: Language = "en", folder: Path | None = None) -> bytes:
    return typeset(made.certificate, made.analysis, language, attachments(made.certificate), folder)


def text_of(page: pypdf.PageObject) -> str:
    """Return the text of a page without line breaks, soft hyphens and spaces, which depend on the layout."""
    return "".join(page.extract_text().replace("\u00ad", "").split())


@pytest.mark.long
@pytest.mark.parametrize(("made", "language"), sampled(3, KINDS, LANGUAGES), indirect=["made"])
def test_every_page_is_identified_and_the_document_is_complete(made: Made, language: Language) -> None:
    content = printed(made, language)
    assert printed(made, language) == content
    pages = [text_of(page) for page in pypdf.PdfReader(io.BytesIO(content)).pages]
    whole = "".join(pages)
    result = made.certificate.result
    for k, page in enumerate(pages, 1):
        assert made.certificate.number in page
        assert (f"Page{k}of{len(pages)}" if language == "en" else f"第{k}页，共{len(pages)}页") in page
    assert VERDICTS[made.certificate.verdict][LANGUAGES.index(language)] in pages[0]
    texts = tomllib.loads((shipped_folder() / "reports" / "texts.toml").read_text(encoding="utf-8"))
    labels = texts["en" if language == "en" else "zh"]
    wanted = [labels[name] for name in ("title", "rule", "results", "expanded", "found", "left", "budget", "inputs")]
    wanted += [labels[name] for name in ("method", "checks", "verification", "environment", "traceability")]
    wanted += [labels[name] for name in ("deviations", "configuration", "authorised", "relates", "excluded")]
    wanted += [result.serial, result.log.sha256, result.configuration_sha256, *LABORATORY["laboratory"]["signatories"]]
    wanted += [LABORATORY["laboratory"]["customer"], "PTB-0815", made.certificate.issued.isoformat(), "k=2", "95"]
    for text in wanted:
        assert "".join(text.replace("\u00ad", "").split()) in whole, text
    assert "标定" not in whole, "the certificate has one word for calibration"
    for name in result.parameters:
        group = parameter_name(name, language).rpartition(" ")[0]
        assert "".join(group.split()).lower() in whole.lower()


@pytest.mark.long
@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("made", CASES, indirect=True, ids=KINDS)
def test_certificate_has_no_names_of_entries_and_limits_as_entered(made: Made, language: Language) -> None:
    built = document(made.certificate, made.analysis, language)
    entries = [text for stage in built["stages"] for text in stage["schedule"]]
    assert any("°/s" in text for text in entries)
    for text in entries:
        assert not re.search(r"[_=\[{]", text), text
        if language == "zh_CN":
            assert not re.search(r"[A-Za-z]{3,}", text.replace("ppm", "")), text
    for row in (row for group in built["groups"] for row in group["rows"]):
        for limit in (row["limit"], row["sigma_limit"]):
            assert len(re.sub(r"\D", "", limit)) <= 4, limit


@pytest.mark.parametrize(
    ("language", "requirement", "column", "bounds"),
    [
        ("en", "within its acceptance limit", "Accepted", ("Lower acceptance limit", "Upper acceptance limit")),
        ("zh_CN", "在接受限内", "接受限", ("接受下限", "接受上限")),
    ],
)
@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_value_in_the_guard_band_exceeds_its_acceptance_limit(
    made: Made, language: Language, requirement: str, column: str, bounds: tuple[str, str]
) -> None:
    """The value is within its limit, so that the certificate must not name the limit as not met."""
    result = made.certificate.result
    guarded = [
        replace(check, value=0.9 * check.limit[1], acceptance=tuple(0.5 * x for x in check.limit), passed=False)
        if check.kind == "within" and isinstance(check.limit, tuple)
        else check
        for check in result.checks
    ]
    data = {**result.to_json(), "outcome": "failed", "passed": False, "checks": [each.to_json() for each in guarded]}
    certificate = build_certificate(Result.from_json(data), made.certificate.meta, budget=made.analysis.budget)
    built = document(certificate, made.analysis, language)
    assert built["verdict_text"].count(requirement) == 4  # and "…"
    rows = [row for each in built["groups"] for row in each["rows"] if row["decision"] == "failed"]
    assert all(row["accepted"] not in (row["limit"], "–") for row in rows)
    assert column in typeset_pages(replace(made, certificate=certificate), language)[0]
    assert column not in typeset_pages(made, language)[0]
    names = write_dcc(certificate).decode()
    assert all(name in names for name in bounds)
    assert not any(name in write_dcc(made.certificate).decode() for name in bounds)


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_certificate_without_laboratory_and_signatories_does_not_name_files(made: Made) -> None:
    plain = replace(made, certificate=replace(made.certificate, laboratory=None, instruments=()))
    for language, (missing, name) in zip(
        LANGUAGES, (("Laboratory not stated.", "Name and function"), ("未注明实验室。", "姓名、职务")), strict=True
    ):
        pages = [text_of(page) for page in pypdf.PdfReader(io.BytesIO(printed(plain, language))).pages]
        assert "".join(missing.split()) in pages[0]
        assert "".join(name.split()) in pages[-1]
        assert "stationfile" not in "".join(pages)
        assert "工位文件" not in "".join(pages)


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_certificate_of_a_simulation_is_marked_next_to_its_verdict(made: Made) -> None:
    words = "Simulation: the run was made on the virtual bench"
    assert words in " ".join(pypdf.PdfReader(io.BytesIO(printed(made))).pages[0].extract_text().split())
    run = made.certificate.meta.run
    assert run is not None
    meta = made.certificate.meta.model_copy(update={"run": run.model_copy(update={"seed": None})})
    real = replace(made, certificate=replace(made.certificate, meta=meta))
    pages = pypdf.PdfReader(io.BytesIO(printed(real))).pages
    assert "Simulation" not in "".join(page.extract_text() for page in pages)


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_certificate_of_a_simulation_shows_no_accreditation(made: Made) -> None:
    meta = made.certificate.meta
    assert meta.run is not None
    assert meta.laboratory is not None
    accredited = meta.laboratory.model_copy(update={"accreditation": "UKAS 0000"})
    simulated = meta.model_copy(update={"laboratory": accredited})
    real = simulated.model_copy(update={"run": meta.run.model_copy(update={"seed": None})})
    recorded = real.model_copy(update={"simulated": True})
    for each, shown in ((simulated, None), (recorded, None), (real, "UKAS 0000")):
        certificate = build_certificate(made.certificate.result, each)
        assert certificate.laboratory is not None
        assert certificate.laboratory.accreditation == shown
        assert certificate.laboratory.name == accredited.name


@pytest.mark.parametrize(
    ("reported", "stage", "refused"),
    [
        ("T-0001", "six_position", True),
        ("T-0042", "six_position", False),
        ("X-1 + T-0042", "six_position", False),  # two drives
        ("", "six_position", False),  # the table reports no serial number
        ("by hand", "multi_position", False),
    ],
)
@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_a_table_with_another_serial_number_gives_no_traceability(
    made: Made, reported: str, stage: str, refused: bool
) -> None:
    result = made.certificate.result.model_copy(update={"stages": [stage]})
    analysis = replace(made.analysis, identified={**made.analysis.identified, "table_serial": reported})
    found = deviations(replace(made.certificate, result=result), analysis)
    other = [text for text in found if text.code == "certificate.d_other_table"]
    assert [text.values for text in other] == ([{"reported": reported, "declared": "T-0042"}] if refused else [])


@pytest.mark.parametrize(("calibrated", "valid"), [(date(2020, 3, 2), True), (date(2120, 3, 2), False)])
@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_an_instrument_that_was_calibrated_later_gives_no_traceability(
    made: Made, calibrated: date, valid: bool
) -> None:
    result = made.certificate.result.model_copy(update={"stages": ["six_position"]})
    table, *others = made.certificate.instruments
    instruments = (table.model_copy(update={"calibrated": calibrated}), *others)
    certificate = replace(made.certificate, result=result, instruments=instruments)
    codes = {text.code for text in deviations(certificate, made.analysis)}
    later = {"certificate.d_calibrated_later", "certificate.d_no_table"}
    assert codes & later == (set() if valid else later)


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_a_stage_ended_by_hand_is_a_deviation_from_the_method(made: Made) -> None:
    stage = made.certificate.result.stages[0]
    result = made.certificate.result.model_copy(update={"ended_by_hand": [stage]})
    found = deviations(replace(made.certificate, result=result), made.analysis)
    assert [t.values for t in found if t.code == "advice.ended_by_hand"] == [{"stages": [stage]}]
    codes = {text.code for text in deviations(made.certificate, made.analysis)}
    assert "advice.ended_by_hand" not in codes


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_number_of_completed_rounds_in_the_log_is_stated(made: Made) -> None:
    schedule = made.certificate.meta.schedule
    planned = {stage: values["rounds"] for stage, values in schedule.items() if values.get("rounds")}
    assert planned
    assert {stage: made.analysis.rounds[stage] for stage in planned} == planned
    fewer = replace(made.analysis, rounds=dict.fromkeys(planned, 0))
    entries = [text for stage in document(made.certificate, fewer, "en")["stages"] for text in stage["schedule"]]
    assert [text for text in entries if "0 (planned: at most" in text]


@pytest.mark.parametrize(("language", "words"), [("en", "gyro bias x, sigma: "), ("zh_CN", "陀螺零偏 x 标准差：")])
@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_the_cause_of_a_failed_check_is_stated_with_its_name_in_words(
    made: Made, language: Language, words: str
) -> None:
    check = Check.compare("sigma_below", 2.0, 1.0, "rad/s", subject="gyro_bias_x")
    values = {"parameter": "gyro_bias_x", "sigma_ppm": 2.0, "limit_ppm": 1.0}
    failed = replace(check, diagnosis=Diagnosis("gravity_uncertain", values=values))
    result = made.certificate.result.model_copy(update={"checks": [failed]})
    found = deviations(replace(made.certificate, result=result), made.analysis)
    (cause,) = (text for text in found if text.code == "certificate.d_cause")
    assert sentence(cause, language, window=True).startswith(words)


@pytest.mark.parametrize(
    ("language", "words"),
    [
        (
            "en",
            "Li Na, B0002 allowed the run although the calibration of 't' was due on 2026-01-02. Reason: x.",
        ),
        ("zh_CN", "Li Na, B0002 放行了本次校准，尽管“t”应于 2026-01-02 前送检。理由：x。"),
    ],
)
@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_certificate_names_who_allowed_a_run_and_despite_what(made: Made, language: Language, words: str) -> None:
    overridden = [{"reason": "certificate", "name": "t", "since": "2026-01-02"}]
    allowed = {"standard_override_by": ["Li Na", "B0002"], "standard_overridden": overridden}
    result = Result.from_json({**made.certificate.result.to_json(), "standard_override": "x", **allowed})
    found = deviations(replace(made.certificate, result=result), made.analysis)
    (text,) = (text for text in found if text.code == "certificate.d_standard_overridden")
    assert sentence(text, language, window=True) == words
    nobody = Result.from_json({**result.to_json(), "standard_override_by": []})  # without sign-in, nobody may be known
    codes = [text.code for text in deviations(replace(made.certificate, result=nobody), made.analysis)]
    assert "certificate.d_standard_override" in codes


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_excluded_uncertainty_contributions_depend_on_the_tests(made: Made) -> None:
    def codes(analysis: Analysis, **changes: Any) -> list[str]:
        result = made.certificate.result.model_copy(update=changes)
        return [text.code for text in not_included(replace(made.certificate, result=result), analysis)]

    tested, untested = (replace(made.analysis, effects_tested=value) for value in (True, False))
    failed = Check.compare("effects", 50.0, 30.0, "1", subject="gimbal")
    clock = Check.compare("sample_clock", 2e-5, 1e-4, "1", subject="gimbal")
    assert "certificate.n_effects_tested" in codes(tested)
    assert "certificate.n_effects_untested" in codes(untested)
    assert "certificate.n_effects_failed" in codes(tested, checks=[failed], passed=False)
    assert {"certificate.n_temperature", "certificate.n_clock_tested"} <= {*codes(tested, checks=[clock])}
    assert "certificate.n_clock" in codes(tested, checks=[])
    unknown = not_included(replace(made.certificate, temperature=None), tested)
    assert "certificate.n_temperature_unknown" in [text.code for text in unknown]


@pytest.mark.parametrize(
    ("language", "words", "label"),
    [
        ("en", "between {0} °C and {1} °C, its temperatures in the data", "Temperature of the unit during the stages"),
        ("zh_CN", "{0} °C 至 {1} °C 的产品温度，即计算数值所用数据的温度范围", "各阶段的产品温度"),
    ],
)
@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_certificate_applies_to_the_temperatures_of_the_solved_stages(
    made: Made, language: Language, words: str, label: str
) -> None:
    """Before and between the stages, the unit warms up; nothing is calibrated at these temperatures."""
    blocks = list(open_log(made.result_file.with_suffix(".h5")).blocks())
    solved = np.concatenate([b.temperature[b.valid] for b in blocks if b.stage in made.certificate.result.stages])
    whole = made.certificate.result.temperature_c
    assert whole is not None
    assert whole.min < solved.min() - 0.1
    bounds = [f"{value:.1f}" for value in (solved.min(), solved.max())]
    built = document(made.certificate, made.analysis, language)
    assert built["environment"]["temperature"] == {"mean": f"{solved.mean():.1f}", "range": bounds}
    assert words.format(*bounds) in " ".join(built["budget"]["excluded"])
    assert "".join(label.split()) in "".join(typeset_pages(made, language))
    conditions = write_dcc(made.certificate).decode().partition("basic_temperature")[2]
    values = [float(value) for value in re.findall(r"<si:value>(.*?)</si:value>", conditions)]
    assert values[:3] == pytest.approx([solved.min(), solved.mean(), solved.max()], abs=1e-3)


@pytest.mark.parametrize(
    ("language", "labels"), [("en", ("Calibrated", "Issued")), ("zh_CN", ("校准日期", "签发日期"))]
)
@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_dates_on_the_first_page_are_in_utc(made: Made, language: Language, labels: tuple[str, str]) -> None:
    page = typeset_pages(made, language)[0]
    for label in labels:
        assert f"{label}{made.certificate.issued}(UTC)" in page


@pytest.mark.parametrize(
    ("language", "heading", "words"),
    [
        ("en", "Valuesandtheirlimits", "Red:requirementnotmet.Triangle:"),
        ("zh_CN", "数值与限差", "红色表示不符合要求，三角形"),
    ],
)
@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_chart_of_the_limits_explains_its_signs(made: Made, language: Language, heading: str, words: str) -> None:
    (page,) = [page for page in typeset_pages(made, language) if words in page]
    assert heading in page


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_nis_and_its_band_have_equal_numbers_of_decimals(made: Made) -> None:
    result = made.certificate.result
    stages = {
        name: each.model_copy(update={"nis_low": 2.7, "nis_high": 3.468}) for name, each in result.consistency.items()
    }
    changed = replace(made.certificate, result=result.model_copy(update={"consistency": stages}))
    (stage, *_) = document(changed, made.analysis, "en")["stages"]
    assert stage["band"] == "2.70 … 3.47"
    assert re.fullmatch(r"\d+\.\d\d", stage["nis"])


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
@pytest.mark.parametrize(
    ("language", "protocol", "words"),
    [
        ("en", None, "Sample stream with command frames (Unit A)"),
        ("zh_CN", None, "数据流和命令帧（Unit A）"),
        ("en", "modbus", "Sample stream and Modbus RTU registers (Unit A)"),
        ("zh_CN", "stream", "数据流，无命令（Unit A）"),
    ],
)
def test_data_interface_is_named_in_words(made: Made, language: Language, protocol: str | None, words: str) -> None:
    profile = tomli_w.dumps({"name": "Unit A", **({} if protocol is None else {"protocol": protocol})})
    meta = made.certificate.meta
    certificate = replace(made.certificate, meta=meta.model_copy(update={"profiles": {"imu": profile}}))
    assert document(certificate, made.analysis, language)["unit"]["imu"] == words
    unknown = replace(made.certificate, meta=meta.model_copy(update={"profiles": {}}))
    assert document(unknown, made.analysis, language)["unit"]["imu"] is None


def test_every_protocol_has_a_name_for_certificates() -> None:
    assert set(catalogue.family("protocol")) == {f"protocol.{name}" for name in ("stream", *PROTOCOLS)}


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_turn_on_to_turn_on_change_is_taken_from_the_imu_profile(made: Made) -> None:
    meta = made.certificate.meta
    stability = {"gyro_bias": {"power_up": 5e-6}, "gyro_bias_z": {"power_up": 7e-6}, "accel_bias": {"year": 1.0}}
    profile = tomli_w.dumps({"stability": stability})
    known = meta.model_copy(update={"profiles": {**meta.profiles, "imu": profile}})
    assert known.turn_on_sigmas == {"gyro_bias_x": 5e-6, "gyro_bias_y": 5e-6, "gyro_bias_z": 7e-6}
    unknown = meta.model_copy(update={"profiles": {}})
    assert unknown.turn_on_sigmas == {}
    texts = [text.code for text in not_included(replace(made.certificate, meta=unknown), made.analysis)]
    assert "certificate.n_stability_unknown" in texts


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_latitude_contribution_follows_from_earth_rate(made: Made) -> None:
    """Gyro biases at rest contain the change of horizontal and vertical earth rate; gravity is surveyed."""
    change = np.deg2rad(LATITUDE_ERROR_DEG) * RATE
    largest = max(made.analysis.budget.latitude[f"gyro_bias_{axis}"] for axis in "xyz")
    assert 0.3 * change < largest < 1.5 * change
    (page,) = [page for page in typeset_pages(made, "en") if "Notinthebudget" in page]
    assert "Frompower-uptopower-up,1σPer0.01°oflatitude" in page


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_the_registers_before_and_after_the_run_are_printed(made: Made) -> None:
    registers = made.certificate.result.registers
    assert registers is not None
    assert registers.new is not None
    held = unit_registers(made.certificate.result, made.certificate.meta)
    assert held["gyro_bias_x"] == (registers.old["gyro_bias_x"], registers.new["gyro_bias_x"])
    (page,) = [page for page in typeset_pages(made, "en") if "Registersoftheunit" in page]
    after = exact(display("gyro_bias_x", registers.new["gyro_bias_x"])[0])
    assert f"Gyrobiasx,°/h{exact(0.0)}{after}" in page
    unchanged = made.certificate.result.model_copy(update={"registers": registers.model_copy(update={"new": None})})
    assert all(old == new for old, new in unit_registers(unchanged, made.certificate.meta).values())


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_first_page_lists_every_imu(made: Made) -> None:
    imu = made.certificate.meta.imu.model_dump(exclude_unset=True)
    second = SecondaryImuSection.model_validate(
        {name: value for name, value in imu.items() if name in SecondaryImuSection.model_fields}
        | {"serial": "SECOND-0002"}
    )
    meta = made.certificate.meta.model_copy(update={"imu2": second})
    pair = replace(made, certificate=replace(made.certificate, meta=meta))
    for language, words in (("en", "SecondaryIMU2SECOND-0002"), ("zh_CN", "从IMU2SECOND-0002")):
        (page, *_) = typeset_pages(pair, language)
        assert words in page


def in_batch(made: Made) -> Made:
    """Return the certificate of a unit as one of three on a table, rotated and off centre."""
    meta = made.certificate.meta
    units = ["SN-000041", meta.imu.serial, "SN-000043"]
    run = meta.run.model_copy(update={"batch": "B20261123T0630-7F", "slot": "A2", "batch_units": units})
    table = meta.table.model_copy(update={"orientation": "-y+z", "outer_lever": "estimated"})
    prior = {**meta.prior, "outer_lever_x": PriorSection(value=0.25), "outer_lever_y": PriorSection(value=-0.1)}
    placed = meta.model_copy(update={"run": run, "table": table, "prior": prior})
    return replace(made, certificate=replace(made.certificate, meta=placed))


@pytest.mark.long
@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_certificate_of_a_batch_unit_states_its_slot_and_the_other_units(made: Made) -> None:
    label = {"en": "Onthetable", "zh_CN": "在转台上的布置"}
    wanted = {
        "en": (
            "UnitinslotA2ofbatchB20261123T0630-7F.",
            "Calibratedonthesametableatthesametimeas:SN-000041,SN-000043(2).",
            "bodyaxis−ywasalongplatformxandbodyaxis+zalongplatformz",
            "inbodyaxesx,y,z:(0.250,−0.100,0.000)m",
        ),
        "zh_CN": (
            "该产品位于批次B20261123T0630-7F的装夹位A2。",
            "与同一转台上的另外2台产品一同校准，序列号：SN-000041,SN-000043。",
            "本体轴−y沿平台x轴，本体轴+z沿平台z轴",
            "（本体轴x、y、z）：（0.250，−0.100，0.000）m",
        ),
    }
    for language in LANGUAGES:
        assert label[language] not in "".join(typeset_pages(made, language))
        whole = "".join(typeset_pages(in_batch(made), language))
        for text in (label[language], *wanted[language]):
            assert text in whole, text
        assert typeset(in_batch(made).certificate, made.analysis, language, []) == typeset(
            in_batch(made).certificate, made.analysis, language, []
        )


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_digital_certificate_states_an_arrangement_only_for_batches(made: Made) -> None:
    assert b"Arrangement on the table" not in write_dcc(made.certificate)
    xml = write_dcc(in_batch(made).certificate)
    assert xml == write_dcc(in_batch(made).certificate)
    text = xml.decode()
    assert "Unit in slot A2 of batch B20261123T0630-7F. Calibrated on the same table" in text
    assert "批次 B20261123T0630-7F 的装夹位 A2。与同一" in text


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_single_unit_of_a_batch_lists_no_other_units(made: Made) -> None:
    meta = made.certificate.meta
    run = meta.run.model_copy(update={"batch": "B1", "slot": "A2", "batch_units": [meta.imu.serial]})
    codes = [text.code for text in arrangement(meta.model_copy(update={"run": run}))]
    assert codes == ["certificate.slot", "certificate.orientation"]  # the gimbal turns about the centre of the unit
    assert list(arrangement(meta)) == []


def typeset_pages(made: Made, language: Language) -> list[str]:
    pdf = typeset(made.certificate, made.analysis, language, [])
    return [text_of(page) for page in pypdf.PdfReader(io.BytesIO(pdf)).pages]


def test_certificates_of_simulated_recordings_are_marked_as_simulated(tmp_path: Path) -> None:
    make_recording("hand", tmp_path / "hand.h5")
    meta = open_log(tmp_path / "hand.h5").meta
    assert meta.run is None
    assert meta.is_simulated


@pytest.mark.long
@pytest.mark.parametrize("made", ["partial"], indirect=True)
def test_partial_calibration_is_never_shown_as_passed(made: Made) -> None:
    assert made.certificate.verdict == "partial"
    text = "".join(page.extract_text() for page in pypdf.PdfReader(io.BytesIO(printed(made))).pages)
    assert "PASS" not in text
    assert "This is not a statement about the whole unit" in " ".join(text.split())
    assert "not improved" in text


#: Changes of a passed result that make other kinds of it, and words of their certificate.
OTHERS: dict[str, tuple[dict[str, Any], str]] = {
    "stopped": ({"outcome": "stopped", "passed": False, "stop_reason": "operator"}, "stopped by the operator"),
    "fault": (
        {
            "outcome": "fault",
            "passed": False,
            "error": "x",
            "error_code": "label.not_passed",
            "error_values": {"serial": "7"},
        },
        "Fault: No label is printed for 7",
    ),
    "incomplete": ({"outcome": "incomplete", "passed": None}, "The run ended before a verdict (incomplete)"),
    "without limits": ({"outcome": "resolved", "passed": None, "registers": None}, "solved again offline"),
    "lacking data": (
        {"outcome": "resolved", "passed": None, "lacking": {"rate": "No rest."}},
        "Data required for the comparison with the limits are missing",
    ),
    "standard overridden": ({"standard_override": "golden unit is away"}, "expired certificate: golden unit is away"),
    "gaps": (
        {
            "log": {"file": "x.h5", "gaps": 3, "damaged": [{"rows": 5, "seq": "1"}]},
            "attempt": 3,
            "resumed_from": "y.h5",
        },
        "The recording has 3 gaps",
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
@pytest.mark.parametrize("kind", OTHERS)
def test_every_other_outcome_has_a_certificate(made: Made, kind: str) -> None:
    changes, words = OTHERS[kind]
    result = Result.from_json({**made.certificate.result.to_json(), **changes})
    certificate = build_certificate(result, made.certificate.meta, budget=made.analysis.budget)
    passed = kind in ("gaps", "standard overridden")
    assert certificate.verdict == ("passed" if passed else "undetermined")
    other = replace(made, certificate=certificate)
    text = " ".join("".join(p.extract_text() for p in pypdf.PdfReader(io.BytesIO(printed(other))).pages).split())
    assert words in text
    assert ("NOT JUDGED" in text) == (not passed)
    assert printed(other, "zh_CN").startswith(b"%PDF")


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_disagreeing_check_standard_is_reported(made: Made) -> None:
    verdict = {"passed": False, "e_n": {}, "e_n_limit": 1.0, "t_squared": 9.0, "t_squared_limit": 1.0}
    changes = {"outcome": "failed", "passed": False, "check_standard": {**verdict, "degrees": 1, "false_alarm": 0.01}}
    result = Result.from_json({**made.certificate.result.to_json(), **changes})
    certificate = build_certificate(result, made.certificate.meta, budget=made.analysis.budget)
    text = " ".join(
        pypdf.PdfReader(io.BytesIO(printed(replace(made, certificate=certificate)))).pages[0].extract_text().split()
    )
    assert "FAIL" in text
    assert "disagree with its reference values" in text
    assert "Not conforming: 0" not in text


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_stated_risk_belongs_to_the_decision(made: Made) -> None:
    """A value within its limits fails if its sigma is too large; the acceptance risk does not apply then."""
    before = {q.name: q for q in made.certificate.quantities}["gyro_bias_x"]
    assert before.decision == "passed"
    assert before.risk is not None
    data = made.certificate.result.to_json()
    for row, check in zip(data["checks"], made.certificate.result.checks, strict=True):
        row["passed"] &= (check.subject, check.kind) != ("gyro_bias_x", "sigma_below")
    result = Result.from_json({**data, "outcome": "failed", "passed": False})
    after = {q.name: q for q in build_certificate(result, made.certificate.meta).quantities}["gyro_bias_x"]
    assert (after.decision, after.risk) == ("failed", None)
    stopped = Result.from_json({**data, "outcome": "stopped", "passed": False})
    assert all(q.risk is None for q in build_certificate(stopped, made.certificate.meta).quantities)


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_file_is_a_pdf_a_3b_with_the_result_attached(made: Made) -> None:
    reader = pypdf.PdfReader(io.BytesIO(printed(made)))
    root: Any = reader.trailer["/Root"]
    xmp = root["/Metadata"].get_data().decode()
    assert "<pdfaid:part>3</pdfaid:part>" in xmp
    assert "<pdfaid:conformance>B</pdfaid:conformance>" in xmp
    assert root["/OutputIntents"][0]["/S"] == "/GTS_PDFA1"
    (file,) = (reference.get_object() for reference in root["/AF"])
    assert file["/AFRelationship"] == "/Source"
    assert file["/EF"]["/F"]["/Subtype"] == "/application/json"
    ((name, (content,)),) = reader.attachments.items()
    assert name == f"{made.certificate.number}.json"
    assert json.loads(content) == made.certificate.result.to_json()
    assert not reader.is_encrypted
    fonts = {font.get_object()["/BaseFont"] for page in reader.pages for font in page["/Resources"]["/Font"].values()}
    assert fonts
    assert all(font[7:8] == "+" for font in fonts)  # subsets, hence embedded


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_uncertainty_budget_adds_up_to_the_variance(made: Made) -> None:
    certificate = made.certificate
    assert certificate.budget is not None
    for quantity in certificate.quantities:
        parts = certificate.budget.variance[quantity.name]
        assert sum(parts.values()) == pytest.approx(quantity.sigma**2, rel=1e-9)
        # Euler's theorem: without noise beyond the profiles, the derivatives alone add up.
        # The offset of the table's axes is in no other part of the variance of the lever arm.
        largest = 0.3 if quantity.name.startswith("outer_lever") else 5e-4
        assert abs(parts["other"]) < largest * quantity.sigma**2
        assert min(parts.values()) > -1e-3 * quantity.sigma**2


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_gravity_error_contributes_fully_to_the_scale_factors(made: Made) -> None:
    relative = context_from_meta(made.certificate.meta).site.relative_gravity_sigma
    assert made.certificate.budget is not None
    for axis in "xyz":
        parts = made.certificate.budget.variance[f"accel_scale_{axis}"]
        assert parts["gravity"] == pytest.approx(relative**2, rel=5e-3)
    assert made.certificate.budget.variance["gyro_bias_x"]["gravity"] < 1e-9 * made.certificate.quantities[0].sigma ** 2


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_as_found_and_as_left_values_are_the_estimate_minus_the_register(made: Made) -> None:
    registers = made.certificate.result.registers
    assert registers is not None
    assert registers.new is not None
    seen = 0
    for quantity in made.certificate.quantities:
        if quantity.name not in registers.old:
            assert quantity.as_found is None
            continue
        seen += 1
        assert quantity.as_found == quantity.value - registers.old[quantity.name]
        assert quantity.as_left == quantity.value - registers.new[quantity.name]
        assert abs(quantity.as_left) < quantity.sigma
    assert seen == 27


@pytest.mark.long
@pytest.mark.parametrize("made", ["failed"], indirect=True)
def test_failed_unit_keeps_the_errors_as_found(made: Made) -> None:
    registers = made.certificate.result.registers
    assert registers is not None
    assert registers.new is None
    rows = [q for q in made.certificate.quantities if q.name in registers.old]
    assert rows
    assert all(q.as_found == q.as_left == q.value - registers.old[q.name] for q in rows)
    partial = replace(made.certificate, result=made.certificate.result.model_copy(update={"partial": True}))
    assert document(partial, made.analysis, "en")["notices"] == ["Partial calibration, Rate only."]


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_repeated_solution_states_the_registers_before_and_after_the_run(made: Made, tmp_path: Path) -> None:
    log = made.result_file.with_suffix(".h5")
    file = tmp_path / "again.json"
    file.write_text(json.dumps(resolve(log).result.to_json()), encoding="utf-8")
    result, _ = load_source(ignore_progress, file)
    run = made.certificate.result.registers
    assert run is not None
    assert result.registers is not None
    assert result.registers == run
    assert result.verified
    again = build_certificate(result, open_log(log).meta)
    assert [q.as_left for q in again.quantities] == [q.as_left for q in made.certificate.quantities]
    (notice,) = document(again, made.analysis, "en")["notices"]
    assert "offline solution" in notice
    remark, *others = (text.code for text in deviations(again, made.analysis) if "register" in sentence(text))
    assert (remark, others) == ("certificate.d_resolved", [])
    verification = document(again, made.analysis, "en")["registers"]
    assert verification["verified"]
    assert verification["rows"]
    assert verification == document(made.certificate, made.analysis, "en")["registers"]
    assert document(made.certificate, made.analysis, "en")["notices"] == []


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_correlation_is_a_valid_correlation_matrix(made: Made) -> None:
    matrix, names = made.certificate.correlation, [q.name for q in made.certificate.quantities]
    assert np.array_equal(matrix, matrix.T)
    assert (np.diag(matrix) == 1.0).all()
    assert np.linalg.eigvalsh(matrix).min() > -1e-9
    known = made.certificate.result.correlation["gyro_bias_y"]["gyro_bias_x"]
    assert matrix[names.index("gyro_bias_x"), names.index("gyro_bias_y")] == known


@pytest.mark.long
@pytest.mark.parametrize("made", ["passed"], indirect=True)
def test_sigma_history_converges_to_the_sigmas_of_the_result(made: Made) -> None:
    analysis = made.analysis
    assert (np.diff(analysis.time) >= 0.0).all()
    for quantity in made.certificate.quantities:
        assert analysis.sigma[-1, INDEX[quantity.name]] == pytest.approx(quantity.sigma)
    assert list(analysis.spans) == ["rate", "six_position", "excitation", "azimuth_flip"]


@pytest.mark.long
@pytest.mark.parametrize("made", ["failed"], indirect=True)
def test_failed_certificate_lists_failed_quantities_and_omitted_steps(made: Made) -> None:
    decisions = {q.name: q.decision for q in made.certificate.quantities}
    assert decisions == dict.fromkeys(("gyro_scale_x", "gyro_scale_y", "gyro_scale_z"), "failed")
    text = " ".join("".join(p.extract_text() for p in pypdf.PdfReader(io.BytesIO(printed(made))).pages).split())
    assert "Gyro scale factor x within its limit" in text
    assert "No registers were written" in text
    assert "The calibration of Thermometer PT-7 was overdue" in text


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_site_templates_override_the_shipped_templates(made: Made, tmp_path: Path) -> None:
    folder = tmp_path / "templates"
    folder.mkdir()
    texts = (shipped_folder() / "reports" / "texts.toml").read_text(encoding="utf-8")
    (folder / "texts.toml").write_text(texts.replace("Calibration certificate", "Works certificate"), encoding="utf-8")
    page = pypdf.PdfReader(io.BytesIO(printed(made, folder=folder))).pages[0]
    assert "Works certificate" in page.extract_text()
    (folder / "certificate.typ").write_text("#nothing_of_this_name", encoding="utf-8")
    with pytest.raises(InputError, match=r"cannot be compiled .unknown variable: nothing_of_this_name"):
        printed(made, folder=folder)
    with pytest.raises(InputError, match="cannot be read"):
        printed(made, folder=tmp_path / "nowhere")


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_certificate_uses_no_installed_font(made: Made, language: Language) -> None:
    supplied = {"CalstationSans-Regular", "CalstationSans-Bold", "DejaVuSansMono"}  # the last one is a part of Typst
    assert {name.removesuffix("-Identity-H") for name in fonts_of(printed(made, language))} == supplied


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_character_without_a_font_is_reported_until_the_site_adds_a_font(made: Made, home: Path) -> None:
    result = Result.from_json({**made.certificate.result.to_json(), "operator": f"李{RARE}"})
    made = replace(made, certificate=replace(made.certificate, result=result))
    with pytest.raises(InputError, match=f"no glyph for {RARE}. Put a font file that has it into .*reports"):
        printed(made)
    write_font(home / "reports" / "squares.ttf", RARE)
    assert "Squares-Regular" in fonts_of(printed(made))


def test_labels_are_in_both_languages() -> None:
    texts = tomllib.loads((shipped_folder() / "reports" / "texts.toml").read_text(encoding="utf-8"))
    assert list(texts["en"]) == list(texts["zh"])
    assert all(texts["en"].values())
    assert all(texts["zh"].values())


@pytest.mark.parametrize("made", ["gimbal"], indirect=True)
def test_all_samples_of_a_recording_that_names_no_stages_count_once(made: Made) -> None:
    log = open_log(made.result_file.with_suffix(".h5"))
    recorder = _SigmaRecorder(log, log.meta, made.certificate.result)
    blocks = [replace(block, stage="") for block in log.blocks()]
    for block in blocks * 2:  # the solver reads such a recording twice
        recorder.observe(block)
    recorder.unused.close()
    known, found = np.concatenate([b.temperature[b.valid] for b in blocks]), recorder.temperature()
    assert found is not None
    assert (found.mean, found.min, found.max) == pytest.approx((known.mean(), known.min(), known.max()), abs=1e-3)
    assert recorder.unused.invalid + recorder.unused.paused == sum(int(np.sum(~b.valid)) for b in blocks)


@pytest.mark.long
def test_manual_calibration_has_a_certificate_without_a_table(tmp_path: Path) -> None:
    station, product = (shipped_folder() / kind for kind in ("stations/virtual_hand.toml", "products/mems_hand.toml"))
    events: list[Event] = []
    request = RunRequest("SN-000007", station, product, None, tmp_path / "runs", "tester")
    execute(request, events.append, Control())
    ended = events[-1]
    assert isinstance(ended, Finalized)
    for language in LANGUAGES:
        out = tmp_path / f"{language}.pdf"
        asked = ReportRequest(Path(ended.result_file), out, language)
        certificate, _ = issue_report(lambda *args, **more: None, asked)
        assert certificate.verdict == "passed"
    text = " ".join(" ".join(p.extract_text() for p in pypdf.PdfReader(tmp_path / "en.pdf").pages).split())
    assert "Laboratory not stated" in text
    assert "azimuth found from the data" in text
    assert "traceability of angles" not in text  # it needs none
