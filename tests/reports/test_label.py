"""Labels are made from results of passed units, and every failure has a remedy."""

import hashlib
import io
import json
import socket
import sys
import time
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import h5py
import numpy as np
import pypdf
import pytest
import tomli_w
import typst
import zxingcpp

from calstation.config import Confirmation, trail_values
from calstation.config.library import shipped_folder
from calstation.devices.imu import TransferOutcome, TransferStep
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError, InputError
from calstation.messages import Language, local_time, render, term
from calstation.records import LogMeta, RawLogWriter, audit_path, open_log, read_audit
from calstation.registers import journal
from calstation.reports import label_template, print_label, print_labels
from calstation.reports.label import label_fields, qr_code
from calstation.results import Result, load_result
from tests.helpers import raises_code, write_log_of
from tests.issued_records import issue_in_records
from tests.records.records_samples import META, make_block
from tests.reports.test_fonts import RARE, fonts_of, write_font
from tests.site_folder import BENCH, PRODUCT, STATION

RESULT: dict[str, Any] = {
    "schema": "calstation.result/1",
    "unit": {"serial": "SN-000042"},
    "stages": ["rate"],
    "outcome": "passed",
    "parameters": {},
    "product": "Gyro ^XA~",
    "station": "line 3",
    "operator": "李娜",
    "started_utc": "2026-11-23T06:30:00+00:00",
    "log": {"file": "SN-000042_1.h5"},
    "configuration": {"product": {"name": "short", "sha256": ""}},
}


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A site folder with a product whose label is `label.zpl`, and a station without a printer."""
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    for folder in ("products", "stations", "runs"):
        (tmp_path / folder).mkdir()
    use_template(tmp_path, "label.zpl", "^XA^FD$serial $product $date^FS^XZ")
    write_station(tmp_path)
    return tmp_path


def use_template(site: Path, name: str, text: str) -> None:
    """Set this label template in the product."""
    (site / "products" / name).write_text(text, encoding="utf-8")
    (site / "products" / "short.toml").write_text(tomli_w.dumps({**PRODUCT, "label": name}), encoding="utf-8")


def write_station(site: Path, **entries: Any) -> Path:
    """Write the station file with these entries."""
    path = site / "stations" / "line.toml"
    path.write_text(tomli_w.dumps({**STATION, "bench": BENCH, **entries}), encoding="utf-8")
    return path


def write_result(site: Path, **changes: Any) -> Path:
    """Write a result file and its log."""
    path = site / "runs" / "SN-000042_1.json"
    path.write_text(json.dumps({**RESULT, **changes}), encoding="utf-8")
    write_log_of(path)
    return path


def printed(site: Path, **changes: Any) -> Path | None:
    return print_label(lambda *_: None, write_result(site, **changes), site / "stations" / "line.toml")


def test_printer_commands_in_values_are_removed(site: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        write_station(site, label={"printer": f"tcp://127.0.0.1:{server.getsockname()[1]}"})
        assert printed(site) is None
        connection, _ = server.accept()
        with connection, connection.makefile("rb") as stream:
            day = local_time(RESULT["started_utc"])[:10]
            assert stream.read().decode() == f"^XA^FDSN-000042 Gyro  XA  {day}^FS^XZ"


def test_same_result_gives_the_same_pdf(site: Path) -> None:
    use_template(site, "label.typ", "#set page(width: 50mm, height: 30mm)\n#sys.inputs.serial #sys.inputs.operator")
    pdf = printed(site)
    assert pdf == site / "labels" / "SN-000042_1.pdf"
    first = pdf.read_bytes()
    assert first.startswith(b"%PDF-")
    printed(site)
    assert pdf.read_bytes() == first
    printed(site, operator="Li Na")
    assert pdf.read_bytes() != first


@pytest.mark.parametrize(
    ("language", "words"),
    [
        ("en", ["serial number SN-000042", "run SN-000042_1", "printer tcp://127.0.0.1:"]),
        ("zh_CN", ["序列号 SN-000042", "标定 SN-000042_1", "打印机 tcp://127.0.0.1:"]),
    ],
)
def test_every_printed_label_is_in_the_audit_trail(site: Path, language: Language, words: list[str]) -> None:
    path, wang = write_result(site), Confirmation("Wang (B0001)", pin="personal")
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        station = write_station(site, label={"printer": address})
        for _ in range(2):
            print_labels(lambda *_, **__: None, [path], station, wang)
    with pytest.raises(DeviceFaultError):
        print_label(lambda *_: None, path, station, wang)
    use_template(site, "label.typ", "#sys.inputs.serial")
    pdf = print_label(lambda *_: None, path, station, wang)
    assert pdf is not None
    first, again, saved = read_audit(audit_path(site)).entries
    assert {(each.event, each.by, each.values["pin"]) for each in (first, again, saved)} == {
        ("label_printed", "Wang (B0001)", "personal")
    }
    assert first.values == again.values
    shown = "\n".join(trail_values(first.values, language, brief=True))
    assert [word for word in words if word not in shown] == []
    assert saved.values["sha256"] == hashlib.sha256(pdf.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("language", "words"), [("en", "Label printed or its PDF made"), ("zh_CN", "打印标签或生成其 PDF")]
)
def test_label_that_was_neither_sent_nor_saved_is_not_in_the_audit_trail(
    site: Path, monkeypatch: pytest.MonkeyPatch, language: Language, words: str
) -> None:
    assert term("audit_event", "label_printed", language) == words
    with socket.create_server(("127.0.0.1", 0)) as server:
        station = write_station(site, label={"printer": f"tcp://127.0.0.1:{server.getsockname()[1]}"})
        with monkeypatch.context() as patch:
            patch.setattr(socket.socket, "sendall", Mock(side_effect=ConnectionResetError("reset")))
            with raises_code(DeviceFaultError, "label.printer_unreachable"):
                print_label(lambda *_: None, write_result(site), station)
    use_template(site, "label.typ", "#sys.inputs.serial")
    (site / "labels").write_text("no folder", encoding="utf-8")
    with raises_code(InputError, "label.unwritable"):
        printed(site)
    assert list(read_audit(audit_path(site)).entries) == []
    (site / "labels").unlink()
    assert printed(site) is not None
    assert [each.event for each in read_audit(audit_path(site)).entries] == ["label_printed"]


def test_label_is_not_printed_if_the_audit_trail_was_changed(site: Path) -> None:
    use_template(site, "label.typ", "#sys.inputs.serial")
    printed(site)
    trail = audit_path(site)
    trail.write_text(trail.read_text("utf-8").replace("SN-000042", "SN-000043"), "utf-8")
    (site / "labels" / "SN-000042_1.pdf").unlink()
    with pytest.raises(ConfigurationError):
        printed(site)
    assert not (site / "labels" / "SN-000042_1.pdf").exists()


def test_shipped_label_uses_no_installed_font(site: Path) -> None:
    use_template(site, "label.typ", (shipped_folder() / "products" / "label.typ").read_text(encoding="utf-8"))
    pdf = printed(site)
    assert pdf is not None
    assert fonts_of(pdf.read_bytes()) == {"CalstationSans-Regular-Identity-H", "CalstationSans-Bold-Identity-H"}


@pytest.mark.skipif(sys.platform == "win32", reason="the time zone of a process cannot be set")
@pytest.mark.parametrize("verdict", ["PASS", "SIMULATED"])
def test_shipped_labels_state_the_zone_of_their_time_and_have_room_for_long_names(
    site: Path, monkeypatch: pytest.MonkeyPatch, verdict: str
) -> None:
    names = {"product": "Navigation grade A, over temperature", "operator": "Maximilian Mustermann (B0001)"}
    result = Result.from_json({**RESULT, **names, "simulated": verdict == "SIMULATED"})
    with monkeypatch.context() as patch:
        patch.setenv("TZ", "Asia/Kolkata")
        time.tzset()
        fields = label_fields(result)
    time.tzset()
    template = shipped_folder() / "products" / "label.typ"
    inputs = {**fields, "qr": qr_code(fields["code"])}
    (page,) = pypdf.PdfReader(
        io.BytesIO(typst.compile(template, sys_inputs=inputs, font_paths=[shipped_folder() / "fonts"]))
    ).pages
    lines = page.extract_text().splitlines()
    assert [line.strip() for line in lines[-7:]] == [
        "Navigation grade A,",
        "over temperature",
        "2026-11-23",
        "12:00 UTC+05:30",
        "line 3",
        "Maximilian",
        "Mustermann (B0001)",
    ]
    assert lines[0].split() == ["SN-000042", verdict]
    assert "^FD$date^FS\n^FO160,97^A0N,18,18^FD$zone^FS" in template.with_suffix(".zpl").read_text(encoding="utf-8")


#: Content of the code of the label of `RESULT`.
CODE = "SN-000042 SN-000042_1"


def test_code_of_the_typst_label_is_readable(site: Path) -> None:
    QImage = pytest.importorskip("PySide6.QtGui", exc_type=ImportError).QImage
    fields = label_fields(Result.from_json(RESULT))
    template = shipped_folder() / "products" / "label.typ"
    inputs = {**fields, "qr": qr_code(fields["code"])}
    png = typst.compile(template, format="png", ppi=300, sys_inputs=inputs, font_paths=[shipped_folder() / "fonts"])
    image = QImage.fromData(png, "PNG").convertToFormat(QImage.Format.Format_Grayscale8)
    pixels = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
    (code,) = zxingcpp.read_barcodes(pixels[:, : image.width()])
    assert code.text == CODE
    assert (fields["run"], fields["certificate"]) == ("SN-000042_1", ""), "no certificate has been issued"


def test_printer_draws_the_same_code(site: Path) -> None:
    use_template(site, "label.zpl", (shipped_folder() / "products" / "label.zpl").read_text(encoding="utf-8"))
    with socket.create_server(("127.0.0.1", 0)) as server:
        write_station(site, label={"printer": f"tcp://127.0.0.1:{server.getsockname()[1]}"})
        assert printed(site) is None
        connection, _ = server.accept()
        with connection, connection.makefile("rb") as stream:
            # QR code model 2, 3 dots per module; error correction M, automatic choice of the mode
            assert f"^BQN,2,3^FDMA,{CODE}^FS" in stream.read().decode()


def test_character_without_a_font_is_reported_until_the_site_adds_a_font(site: Path) -> None:
    use_template(site, "label.typ", "#sys.inputs.operator")
    with pytest.raises(InputError, match=f"no glyph for {RARE}. Put a font file that has it into .*products"):
        printed(site, operator=f"李{RARE}")
    write_font(site / "products" / "squares.ttf", RARE)
    pdf = printed(site, operator=f"李{RARE}")
    assert pdf is not None
    assert "Squares-Regular" in fonts_of(pdf.read_bytes())


@pytest.mark.parametrize(
    ("name", "template", "error", "text"),
    [
        ("label.zpl", "^FD$serail^FS", InputError, "“$serail”, which does not exist. Use one of: serial, product,"),
        ("label.zpl", "^FD5 $ ^FS", InputError, "cannot be filled in (Invalid placeholder"),
        (
            "label.zpl",
            "^FD$serial^FS",
            ConfigurationError,
            "The station has no label printer. Add [label] with printer",
        ),
        ("label.typ", "#sys.inputs.serail", InputError, "cannot be compiled (dictionary does not contain key"),
    ],
)
def test_unusable_label_template_is_reported(
    site: Path, name: str, template: str, error: type[CalstationError], text: str
) -> None:
    use_template(site, name, template)
    with pytest.raises(error) as raised:
        printed(site)
    assert text in str(raised.value)
    assert render(raised.value.code, raised.value.values, "zh_CN").remedy


def test_unreachable_printer_is_a_device_fault(site: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    write_station(site, label={"printer": f"tcp://127.0.0.1:{port}"})
    with pytest.raises(DeviceFaultError, match=r"cannot be reached .connection refused.*Switch it on"):
        printed(site)


@pytest.mark.parametrize(
    "changes",
    [{"outcome": "failed"}, {"partial": True}, {"outcome": "stopped"}, {"outcome": "resolved"}, {"configuration": {}}],
    ids=str,
)
def test_only_a_passed_full_run_has_a_label(site: Path, changes: dict[str, Any]) -> None:
    assert label_template(load_result(write_result(site))) == site / "products" / "label.zpl"
    assert label_template(load_result(write_result(site, **changes))) is None
    with pytest.raises(InputError, match="No label is printed for SN-000042"):
        printed(site, **changes)


def test_labels_of_several_units_are_printed_one_after_another(site: Path) -> None:
    use_template(site, "label.typ", "#set page(width: 50mm, height: 30mm)\n#sys.inputs.serial")
    first = write_result(site)
    second = first.rename(first.with_name("SN-000043_1.json"))
    write_log_of(second)
    done: list[float] = []
    labels = print_labels(lambda fraction, *_, **__: done.append(fraction), [write_result(site), second], None)
    assert [pdf.name for pdf in labels.pdfs] == ["SN-000042_1.pdf", "SN-000043_1.pdf"]
    assert labels.errors == {}
    assert done == [0.0, 0.5]


def test_refused_label_does_not_prevent_those_of_other_units_but_an_unreachable_printer_does(site: Path) -> None:
    second = write_result(site).rename(site / "runs" / "SN-000043_1.json")
    third = write_result(site).rename(site / "runs" / "SN-000044_1.json")
    refused = write_result(site, outcome="failed")
    for file in (second, third):
        write_log_of(file)
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    station = write_station(site, label={"printer": f"tcp://127.0.0.1:{port}"})
    labels = print_labels(lambda *_, **__: None, [refused, second, third], station)
    assert labels.errors[refused].code == "label.not_passed"
    assert labels.errors[second] == labels.errors[third]
    assert "cannot be reached" in render(labels.errors[third].code, labels.errors[third].values, "en").text


def test_no_label_is_printed_for_a_unit_that_failed_later(site: Path) -> None:
    passed = write_result(site)
    name = "SN-000042_20990101T000000"
    later = {"outcome": "failed", "started_utc": "2099-01-01T00:00:00+00:00", "log": {"file": f"{name}.h5"}}
    failed = {**json.loads(passed.read_text(encoding="utf-8")), **later}
    (passed.parent / f"{name}.json").write_text(json.dumps(failed), encoding="utf-8")
    file = passed.parent / f"{name}.json"
    failing = pytest.raises(InputError, match="failed in a later run, started 2099-01-01")
    with failing as caught:
        print_label(lambda *args, **more: None, passed, None)
    assert "不合格" in render(caught.value.code, caught.value.values, "zh_CN").text
    file.unlink()  # the index still knows the run, which does not become undone
    with pytest.raises(InputError, match="failed in a later run"):
        print_label(lambda *args, **more: None, passed, None)
    file.write_text(json.dumps({**failed, "partial": True}), encoding="utf-8")
    with pytest.raises(InputError, match="failed in a later run"):
        print_label(lambda *args, **more: None, passed, None)


def test_label_states_only_an_issued_certificate(site: Path) -> None:
    result_file = write_result(site)
    (site / "runs" / "reports.jsonl").write_text("damaged\n", encoding="utf-8")
    assert label_fields(load_result(result_file), result_file.parent)["certificate"] == ""
    (site / "runs" / "reports.jsonl").unlink()
    issue_in_records(site, site / "runs", "SN-000042_1")
    fields = label_fields(load_result(result_file), result_file.parent)
    assert fields["certificate"] == "SN-000042_1"
    assert fields["code"] == CODE
    issue_in_records(site, site / "runs", "SN-000042_1", revision=1)
    assert label_fields(load_result(result_file), result_file.parent)["certificate"] == "SN-000042_1-R1"


def test_no_label_is_printed_for_an_edited_result_or_without_its_log(site: Path) -> None:
    path = write_result(site, outcome="failed", passed=False)
    path.write_text(json.dumps({**RESULT}), encoding="utf-8")
    with raises_code(InputError, "result.altered"):
        print_label(lambda *args, **more: None, path, None)
    path.with_suffix(".h5").unlink()
    with raises_code(InputError, "report.no_log"):
        print_label(lambda *args, **more: None, path, None)


def test_every_shipped_template_uses_known_fields() -> None:
    from string import Template

    fields = label_fields(Result.from_json(RESULT))
    text = (shipped_folder() / "products" / "label.zpl").read_text(encoding="utf-8")
    assert "SN-000042" in Template(text).substitute(fields)


def test_unit_with_limits_that_no_stage_judged_gets_no_label(site: Path) -> None:
    with pytest.raises(InputError) as caught:
        printed(site, not_compared=["gyro_bias_x", "gyro_bias_y", "gyro_bias_z"])
    assert caught.value.code == "label.not_judged"
    languages: tuple[Language, ...] = ("en", "zh_CN")
    texts = [render(caught.value.code, caught.value.values, each, window=True).text for each in languages]
    assert "gyro bias" in texts[0]
    assert "陀螺零偏" in texts[1]
    use_template(site, "label.typ", "#set page(width: 50mm, height: 30mm)\n#sys.inputs.serial")
    known = {"not_compared": ["gyro_bias_x"], "unobservable": ["gyro_bias_x"]}  # from the calibration before
    assert printed(site, **known) is not None


@pytest.mark.parametrize("stated", [True, False])
def test_label_of_a_simulated_run_says_so(site: Path, stated: bool) -> None:
    """The result of an earlier version does not state it, but the log does."""
    use_template(site, "label.zpl", "^XA^FD$serial $verdict^FS^XZ")
    path = site / "runs" / "SN-000042_1.json"
    path.write_text(json.dumps({**RESULT, "simulated": True} if stated else RESULT), encoding="utf-8")
    run = {"stages": ["rate"], "software": "0.1", "started_utc": RESULT["started_utc"], "seed": 5}
    writer = RawLogWriter(path.with_suffix(".h5"), LogMeta.model_validate({**META, "run": run}))
    writer.add_result(json.loads(path.read_text("utf-8")))
    writer.close("passed")
    with socket.create_server(("127.0.0.1", 0)) as server:
        station = write_station(site, label={"printer": f"tcp://127.0.0.1:{server.getsockname()[1]}"})
        print_label(lambda *_: None, path, station)
        connection, _ = server.accept()
        with connection, connection.makefile("rb") as stream:
            assert stream.read().decode() == "^XA^FDSN-000042 SIMULATED^FS^XZ"


@pytest.mark.parametrize(
    ("code", "words"),
    [("en", "no longer contains the registers of this run"), ("zh_CN", "中已不是本次标定写入的寄存器值")],
)
def test_label_of_a_run_whose_registers_were_replaced_says_so(site: Path, code: Language, words: str) -> None:
    use_template(site, "label.typ", "#set page(width: 50mm, height: 30mm)\n#sys.inputs.serial")
    new = {"gyro_bias_x": 1.0}
    path = write_result(site, registers={"new": new, "verified": True, "written_utc": RESULT["started_utc"]})
    for value, purpose in ((1.0, ("run", "SN-000042_1.h5")), (2.0, ("hand", "other.h5"))):
        assert print_labels(lambda *_, **__: None, [path], None).cautions == []
        purposed = journal.Purpose("wang", *purpose)
        made = journal.begin(site / "runs", "SN-000042", {"gyro_bias_x": 0.0}, {"gyro_bias_x": value}, purposed)
        made.note(TransferStep.COMMITTING)
        made.close(TransferOutcome.DONE)
    labels = print_labels(lambda *_, **__: None, [path], None)
    assert (len(labels.pdfs), labels.errors) == (1, {})
    (caution,) = labels.cautions
    assert words in render(caution.code, caution.values, code).text
    made.path.write_text("damaged\n", encoding="utf-8")
    (caution,) = print_labels(lambda *_, **__: None, [path], None).cautions
    assert caution.code == "journal.damaged"


def test_no_label_is_printed_for_a_log_that_was_changed_after_the_run(site: Path) -> None:
    use_template(site, "label.typ", "#set page(width: 50mm, height: 30mm)\n#sys.inputs.serial")
    path = site / "runs" / "SN-000042_1.json"
    log, sha256 = path.with_suffix(".h5"), ""
    for _ in range(2):  # the result contains the digest of the samples
        path.write_text(json.dumps({**RESULT, "log": {**RESULT["log"], "sha256": sha256}}), encoding="utf-8")
        log.unlink(missing_ok=True)
        writer = RawLogWriter(log, LogMeta.model_validate(META))
        writer.append(make_block("rate", 0, 50))
        writer.add_result(json.loads(path.read_text("utf-8")))
        writer.close("passed")
        sha256 = open_log(log).facts().sha256
    assert print_label(lambda *_: None, path, None) is not None
    with h5py.File(log, "r+") as file:
        file["samples"][3:5] = file["samples"][4:6]
    with raises_code(InputError, "label.log_changed"):
        print_label(lambda *_: None, path, None)
