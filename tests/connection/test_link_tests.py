"""A link test reports every kind of link fault and passes a working link."""

import socket
import struct
import sys
import threading
import time
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from serial.tools import list_ports

from calstation.config import confirmation_key, load_station
from calstation.config.library import find
from calstation.connection import (
    LinkTestRequest,
    check_imu_link,
    check_table_link,
    discover_ports,
    incompatibilities,
    link_test_configuration,
    table_test,
)
from calstation.connection import identify as who_answers
from calstation.devices.links import SerialLink
from calstation.devices.profiles import SerialSettings
from calstation.errors import ConfigurationError
from calstation.messages import Finding, Report, sentence
from tests.connection import fake_links as wires
from tests.connection.fake_links import FakeImu, FakeTable, english_texts, order, rtu, server, silent, terminal

needs_terminals = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals on Windows")


@pytest.fixture(autouse=True)
def three_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search only three unit numbers for other devices, because every timeout takes time."""
    monkeypatch.setattr(who_answers, "UNIT_NUMBERS", range(1, 4))


def no_progress(fraction: float, remaining_s: float | None = None, note: str = "") -> None:
    """Ignore progress reports."""
    assert 0.0 <= fraction <= 1.0


def table(**section: Any) -> Report:
    """Test a table with these link settings."""
    return check_table_link(no_progress, order(table=section))


def imu(**section: Any) -> Report:
    """Test an IMU with these link settings."""
    return check_imu_link(no_progress, order(imu=section))


def wrong(report: Report) -> Finding:
    """Return the only failed finding."""
    (finding,) = [f for f in report.findings if f.state == "error"]
    assert report.state == "error"
    return finding


def test_state_of_a_report_is_the_state_of_its_worst_finding() -> None:
    for states, worst in (
        ((), "ok"),
        (("info",), "ok"),
        (("ok", "info"), "ok"),
        (("ok", "warning", "info"), "warning"),
        (("warning", "error", "ok"), "error"),
    ):
        assert Report("imu", tuple(Finding("rate", state) for state in states)).state == worst


# A right link


def test_table_of_the_virtual_bench_passes() -> None:
    report = check_table_link(no_progress, order(bench={"seed": 1}))
    assert report.state == "ok"
    identified = report.find("identified")
    assert identified is not None
    assert identified.values == {"model": "bench-table", "serial": "T-0001"}
    watchdog, angles, travel = (report.find(name) for name in ("watchdog", "angles", "travel"))
    assert watchdog is not None
    assert watchdog.values["seconds"] == 10.0
    assert angles is not None
    assert travel is not None
    assert (travel.values["low"], travel.values["high"]) == (-1080.0, 1080.0)


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (4, ("The fault “drive” is latched.", "Remove its cause, then press “Reset the fault”.")),
        (
            0,
            (
                "A fault is latched, and the table does not report its cause.",
                "Read the table's display, remove the cause, then press “Reset the fault”.",
            ),
        ),
    ],
)
def test_latched_fault_is_reported_with_its_cause_if_available(code: int, expected: tuple[str, str]) -> None:
    fake = FakeTable({})
    fake.words[17], fake.words[18] = 1 << 9 | 1 << 3, code
    with server(fake.answer) as address:
        report = table(port=f"tcp://{address}", timeout_s=5.0)
    assert report.state == "warning"
    assert expected in [english_texts(finding) for finding in report.findings]


def test_imu_of_the_virtual_bench_passes() -> None:
    report = check_imu_link(no_progress, order(bench={"seed": 1}))
    assert report.state == "ok"
    rate, gravity, registers = (report.find(name) for name in ("rate", "gravity", "registers"))
    assert rate is not None
    assert rate.values["measured"] == pytest.approx(200.0, abs=2.0)
    assert gravity is not None
    assert gravity.values["measured"] == pytest.approx(9.795, abs=0.1)
    assert registers is not None
    assert registers.values["count"] == 27


@needs_terminals
def test_serial_links_pass_and_the_table_state_is_reported() -> None:
    bench = {
        "table_transport": "rtu",
        "imu_transport": "pty",
        "watchdog_ms": 0,
        "interlock_closed": False,
        "low_deg": [-90.0, -1080.0],
    }
    report = check_table_link(no_progress, order(bench=bench))
    assert wrong(report).id == "watchdog_off"
    assert [f.id for f in report.findings if f.state == "warning"] == ["interlock_open", "travel_narrower"]
    narrower = report.find("travel_narrower")
    assert narrower is not None
    assert narrower.values["joint"] == "outer"
    assert narrower.values["low"] == pytest.approx(-90.0)


def test_angle_outside_the_travel_is_an_error_if_the_table_is_homed() -> None:
    fake = FakeTable({30: 2000.0 / 1e-5})
    with server(fake.answer) as address:
        report = table(port=f"tcp://{address}")
        assert report.state == "warning"
        assert "word order" in english_texts(next(f for f in report.findings if f.id == "outside_travel"))[1]
        fake.words[17] |= 1 << 12
        found = wrong(table(port=f"tcp://{address}"))
    assert (found.id, found.values["joint"]) == ("outside_travel", "outer")
    assert found.values["angle"] == pytest.approx(2000.0)
    assert set(fake.functions) == {3}, "something was written to the table"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda reply: b"\0\0" + reply[2:], "gateway_transaction"),
        (lambda reply: reply[:6] + b"\xff" + reply[7:], "gateway_unit"),
    ],
)
def test_the_deviation_of_a_gateway_is_named(change: Any, expected: str) -> None:
    fake = FakeTable({})
    with server(lambda heard: change(fake.answer(heard))) as address:
        assert wrong(table(port=f"tcp://{address}")).id == expected


def test_a_gateway_that_closes_the_connection_is_named() -> None:
    fake = FakeTable({})

    def answer_once() -> None:
        fake.functions.clear()

    def answer(heard: bytes) -> bytes:
        if fake.functions:
            raise ConnectionError
        return fake.answer(heard)

    with server(answer, answer_once) as address:
        assert wrong(table(port=f"tcp://{address}")).id == "gateway_closed"


def test_a_late_answer_is_named_with_its_delay() -> None:
    fake = FakeTable({})

    def late(heard: bytes) -> bytes:
        time.sleep(0.25)
        return fake.answer(heard)

    with server(late) as address:
        found = wrong(table(port=f"tcp://{address}"))
    assert found.id == "late_reply"
    assert found.values["seconds"] == pytest.approx(0.25, abs=0.2)
    assert set(fake.functions) == {3}, "something was written to the table"


@needs_terminals
def test_a_late_answer_on_a_serial_line_does_not_blame_the_shielding() -> None:
    requests: list[tuple[float, bytes]] = []

    def answer(heard: bytes) -> bytes:
        requests.append((time.monotonic(), heard))
        return b""

    def sends() -> bytes:
        if not requests or time.monotonic() - requests[0][0] < 0.3:
            return b""
        _, heard = requests.pop(0)
        count = heard[5]
        return rtu(bytes([heard[0], 3, 2 * count]) + bytes(2 * count))

    with terminal(answer, sends) as port:
        assert wrong(table(port=port)).id == "late_reply"


# A port that does not open


@pytest.mark.parametrize("test", [table, imu])
def test_missing_port_is_reported(test: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(list_ports, "comports", lambda: [])
    found = wrong(test(port="/dev/ttyNONE7"))
    assert (found.id, found.values["port"], found.values["found"]) == ("no_port", "/dev/ttyNONE7", "")
    assert wrong(test(port="usb:A9")).id == "no_adapter"


@needs_terminals
@pytest.mark.parametrize("test", [table, imu])
def test_port_in_use_is_reported(test: Any) -> None:
    with terminal(silent) as port:
        other = SerialLink(port, SerialSettings(), "imu")
        assert wrong(test(port=port)).id == "busy"
        other.close()


def test_refused_tcp_connection_is_reported() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        address = f"127.0.0.1:{closed.getsockname()[1]}"
    found = wrong(table(port=f"tcp://{address}"))
    assert (found.id, f"{found.values['host']}:{found.values['number']}") == ("refused", address)
    assert wrong(imu(port=f"socket://{address}")).id == "refused"
    with pytest.raises(ConfigurationError, match=r"table.port: “tcp://plc” is not an address. Write tcp://host:port"):
        table(port="tcp://plc")


# A table that does not answer, or not as it should


@pytest.mark.long
def test_unresponsive_table_over_tcp_is_reported() -> None:
    with server(silent) as address:
        found = wrong(table(port=f"tcp://{address}", unit=7))
    assert (found.id, found.values["unit"]) == ("silent_tcp", 7)


def test_device_without_modbus_is_reported() -> None:
    with server(lambda _: b"HTTP/1.1 400 Bad Request\r\n\r\n") as address:
        assert wrong(table(port=f"tcp://{address}")).id == "not_modbus"


def test_device_without_modbus_that_closes_the_connection_is_no_gateway() -> None:
    """A web server closes the connection after its answer to a request that is not HTTP."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            with suppress(OSError):
                while True:
                    connection, _ = listener.accept()
                    with connection:
                        connection.recv(64)
                        connection.sendall(b"HTTP/1.1 400 Bad Request\r\nConnection: close\r\n\r\n")

        threading.Thread(target=serve, daemon=True).start()
        finding = wrong(table(port="tcp://{}:{}".format(*listener.getsockname())))
        listener.shutdown(socket.SHUT_RDWR)
    assert finding.id == "not_modbus"
    assert "not in Modbus TCP" in sentence(finding.message)
    assert "不是 Modbus TCP" in sentence(finding.message, "zh_CN")


def test_usual_port_of_modbus_is_not_recommended_where_it_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    with server(lambda _: b"HTTP/1.1 400 Bad Request\r\n\r\n") as address:
        monkeypatch.setattr(table_test, "_MODBUS_PORT", int(address.rpartition(":")[2]))
        finding = wrong(table(port=f"tcp://{address}"))
    assert finding.message.code == "finding.not_modbus_502"
    assert "address" in sentence(finding.message)
    assert "地址" in sentence(finding.message, "zh_CN")


class FakeDrives:
    """Two drives at one address; `inner` states how the inner drive, unit 2, responds."""

    def __init__(self, inner: str) -> None:
        self.inner = inner
        self.words = [0] * 46
        self.words[0:8] = struct.unpack(">8H", b"bench-drive".ljust(16, b"\0"))

    def answer(self, heard: bytes) -> bytes:
        if heard[6] == 2 and self.inner == "silent":
            return b""
        if heard[6] == 2 and self.inner == "refuses":
            return wires.tcp_pdu(heard, bytes([0x83, 11]))
        start, count = struct.unpack(">HH", heard[8:12])
        words = list(self.words)
        words[32:34] = [0, 0x7FC0] if self.inner == "no number" else [0, 0]  # the rate, a float
        values = struct.pack(f">{count}H", *words[start : start + count])
        return wires.tcp_pdu(heard, bytes([3, len(values)]) + values)


@pytest.mark.long
@pytest.mark.parametrize(
    ("inner", "expected", "unit"),
    [("silent", "silent_tcp", 2), ("refuses", "exception", 2), ("no number", "no_number", None)],
)
def test_faulty_drive_of_two_is_reported(inner: str, expected: str, unit: int | None) -> None:
    with server(FakeDrives(inner).answer) as address:
        found = wrong(table(profile="cia402_drives", port=f"tcp://{address}"))
    assert (found.id, found.values.get("unit")) == (expected, unit)


@pytest.mark.parametrize("code", [2, 4, 11])
def test_modbus_exception_of_the_table_is_reported(code: int) -> None:
    with server(lambda heard: wires.tcp_pdu(heard, bytes([0x83, code]))) as address:
        found = wrong(table(port=f"tcp://{address}"))
    assert (found.id, found.values["code"], found.values["unit"]) == ("exception", code, 1)


def test_table_of_another_model_is_reported() -> None:
    name = b"other-table".ljust(16, b"\0")
    with server(lambda heard: wires.tcp_pdu(heard, bytes([3, 16]) + name)) as address:
        found = wrong(table(port=f"tcp://{address}"))
    assert found.id == "wrong_model"
    assert found.values == {"found": "other-table", "expected": "bench-table"}


@needs_terminals
@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (silent, "silent_rtu"),
        (lambda _: bytes(range(0x80, 0xA0)), "garbled"),
        (lambda _: rtu(bytes([1, 3, 16]) + b"bench-table".ljust(16, b"\0"))[:-1] + b"\x00", "crc"),
        (lambda _: rtu(bytes([9, 3, 16]) + b"bench-table".ljust(16, b"\0")), "other_unit"),
        (lambda heard: heard, "echo"),
    ],
)
def test_wrong_serial_settings_of_a_modbus_table_are_reported(answer: Any, expected: str) -> None:
    with terminal(answer) as port:
        found = wrong(table(port=port, serial={"baud": 19200}))
    assert found.id == expected
    assert (found.values["baud"], found.values["parity"]) == (19200, "N")


@needs_terminals
def test_serial_settings_rejected_by_the_port_are_reported() -> None:
    with terminal(silent) as port:  # a pseudo-terminal has no parity
        found = wrong(table(port=port, serial={"parity": "E"}))
    assert (found.id, found.values["parity"]) == ("bad_settings", "E")


@pytest.mark.long
@needs_terminals
@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (silent, "silent_text"),
        (lambda _: bytes(range(0x80, 0xA0)), "garbled_text"),
        (lambda _: b"login: ", "unlike_text"),
        (lambda _: b"HELLO\r\n>", "unlike_answer"),
        (lambda _: b"?invalid\r\n>", "line_refused"),
    ],
)
def test_wrong_serial_settings_of_a_text_table_are_reported(answer: Any, expected: str) -> None:
    with terminal(answer) as port:
        assert wrong(table(profile="aerosmith_atl", port=port)).id == expected


@needs_terminals
def test_text_table_on_the_port_of_the_imu_is_reported() -> None:
    unit = FakeImu()
    with terminal(silent, unit.sends) as port:
        report = table(profile="aerosmith_atl", port=port)
        assert wrong(report).id == "garbled_text"
        assert "perhaps the IMU" in english_texts(wrong(report))[1]


def test_unprintable_bytes_are_shown_as_numbers() -> None:
    noise = bytes(range(256)) * 8
    with server(lambda _: noise + b"\r\n") as address:
        found = wrong(table(profile="acutronic_acl", port=f"tcp://{address}"))
    assert found.id == "garbled_text"
    assert "baud" not in found.values
    with server(lambda _: b"\x01login: " + b"a" * 500 + b"\r\n") as address:
        found = wrong(table(profile="acutronic_acl", port=f"tcp://{address}"))
    text, mend = english_texts(found)
    assert "\\x01login: aaa" in text + mend
    assert len(text + mend) < 300


@pytest.mark.long
@needs_terminals
def test_remedy_refers_to_the_settings_of_a_serial_server() -> None:
    with server(lambda _: bytes(range(0x80, 0xA0))) as address:
        garbled = wrong(table(port=f"socket://{address}"))
    assert garbled.id == "garbled"
    assert english_texts(garbled)[1].startswith("Set the baud and parity in the serial server (115200")
    with server(silent) as address:
        assert "set in the serial server" in english_texts(wrong(table(port=f"socket://{address}")))[1]


def test_unresponsive_text_table_over_tcp_is_reported() -> None:
    with server(silent) as address:
        assert wrong(table(profile="acutronic_acl", port=f"tcp://{address}")).id == "silent_host"


# An IMU that does not answer, or not as it should


@needs_terminals
@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        (FakeImu(rate=0.0, mute=True), "silent"),
        (FakeImu(mute=True), "one_way"),
        (FakeImu(mute=True, check="crc16_modbus"), "wrong_checks"),
        (FakeImu(model="other"), "wrong_model"),
    ],
)
def test_invalid_imu_responses_are_reported(unit: FakeImu, expected: str) -> None:
    with terminal(unit.answer, unit.sends) as port:
        assert wrong(imu(port=port)).id == expected


def test_imu_at_another_baud_rate_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    unit = FakeImu()

    class AtBaud:
        """A unit at 460800 baud; elsewhere its bytes are noise."""

        received_at = property(lambda link: time.monotonic())

        def __init__(self, port: str, settings: SerialSettings) -> None:
            self.port, self._right = port, settings.baud == 460800

        def read(self, wait: float) -> bytes:
            return unit.sends() if self._right else b"\x99" * 64

        def write(self, data: bytes) -> None:
            assert data

        def close(self) -> None:
            """Nothing to close."""

    for module in ("calstation.connection.devices", who_answers.__name__):
        monkeypatch.setattr(f"{module}.open_link", AtBaud)
    monkeypatch.setattr(who_answers, "LISTEN_TIME", 0.01)
    report = imu(port="COM7", serial={"baud": 115200})
    assert wrong(report).id == "no_frames"
    elsewhere = report.find("other_baud")
    assert elsewhere is not None
    assert elsewhere.values == {"baud": 115200, "found": 460800}


@needs_terminals
def test_imu_stream_that_contradicts_its_profile_is_reported() -> None:
    unit = FakeImu(rate=100.0, skip=7, counts=[0, 0, 0, 0, 0, 4_000], status=5)
    with terminal(unit.answer, unit.sends) as port:
        report = imu(port=port)
    assert {f.id for f in report.findings if f.state == "error"} == {"wrong_rate", "gaps", "wrong_gravity"}
    gaps = report.find("gaps")
    assert gaps is not None
    assert (gaps.values["gaps"], gaps.values["missing"]) == (1, 7)
    assert [f.id for f in report.findings if f.state == "warning"] == ["self_test_failed"]


@needs_terminals
def test_stored_samples_that_arrive_first_do_not_count_as_the_rate() -> None:
    unit = FakeImu(stored=400)
    with terminal(unit.answer, unit.sends) as port:
        report = imu(port=port)
    rate = report.find("rate")
    assert rate is not None
    assert float(str(rate.values["measured"])) == pytest.approx(200.0, rel=0.05)


@pytest.mark.long
@needs_terminals
def test_site_confirmed_on_another_computer_is_reported() -> None:
    unit = FakeImu()
    with terminal(unit.answer, unit.sends) as port:
        asked = order(imu={"port": port, "timeout_s": 0.3})
        found = []
        for computers in ([], ["other-plant"], ["other-plant", confirmation_key(asked.station.site)]):
            site = asked.station.site.model_copy(update={"confirmed_on": computers})
            station = asked.station.model_copy(update={"site": site})
            found.append(check_imu_link(no_progress, LinkTestRequest(station)).find("place_not_confirmed"))
    assert [finding is not None for finding in found] == [False, True, False]


@needs_terminals
def test_serial_number_that_does_not_match_the_product_is_reported(tmp_path: Path) -> None:
    product = tmp_path / "product.toml"
    product.write_text('name = "p"\nimu = "bench_nav"\nserial_pattern = "X.*"\n', encoding="utf-8")
    unit = FakeImu()
    with terminal(unit.answer, unit.sends) as port:
        report = check_imu_link(no_progress, order(product, imu={"port": port}))
    unlike = report.find("serial_unlike")
    assert unlike is not None
    assert unlike.state == "warning"
    assert unlike.values == {"serial": "SN-000042", "pattern": "X.*"}


@pytest.fixture
def streaming(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A product with a stream-only IMU."""
    text = find("imus", "bench_nav").read_text(encoding="utf-8").replace("[link]", 'protocol = "stream"\n[link]')
    data = {k: v for k, v in tomllib.loads(text).items() if k not in ("commands", "registers", "corrected")}
    for name, content in (
        ("imus/quiet.toml", tomli_w.dumps(data)),
        ("products/quiet.toml", 'name = "p"\nimu = "quiet"\nserial_pattern = "X.*"\n'),
    ):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(content, encoding="utf-8")
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    return tmp_path / "products" / "quiet.toml"


@needs_terminals
def test_stream_only_imu_passes(streaming: Path) -> None:
    unit = FakeImu(mute=True)
    with terminal(unit.answer, unit.sends) as port:
        report = check_imu_link(no_progress, order(streaming, imu={"port": port}))
    assert report.state == "ok"
    assert [f.id for f in report.findings][:3] == ["opened", "cannot_tell", "registers"]
    assert report.find("rate") is not None


@pytest.mark.long
@needs_terminals
def test_silent_or_wrong_baud_rate_of_a_stream_only_imu_is_reported(
    streaming: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(who_answers, "LISTEN_TIME", 0.01)
    for sends, expected in ((bytes, "silent"), (lambda: b"\x99" * 64, "no_frames")):
        with terminal(silent, sends) as port:
            assert wrong(check_imu_link(no_progress, order(streaming, imu={"port": port}))).id == expected


def test_a_site_is_compared_with_the_shipped_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    shipped = find("stations", "example_hardware")
    own = tmp_path / "stations" / "example_hardware.toml"
    own.parent.mkdir()
    found = []
    for text in (shipped.read_text("utf-8"), shipped.read_text("utf-8").replace("34.25", "31.2")):
        own.write_text(text, "utf-8")
        setup = link_test_configuration(LinkTestRequest(load_station(own)[1]))
        found.append("example_site" in [finding.id for finding in incompatibilities(setup)])
    assert found == [True, False]


@pytest.mark.parametrize(
    ("site", "warning"),
    [
        ("gravity_sigma_mps2 = 1e-6", "gravity_sigma_small"),
        ("gravity_mps2 = 9.79547", "gravity_normal"),
        ("gravity_mps2 = 9.7961\ngravity_sigma_mps2 = 1e-6", ""),
        ("", ""),
    ],
)
def test_computed_gravity_that_passes_as_surveyed_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, site: str, warning: str
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    file = tmp_path / "stations" / "line.toml"
    file.parent.mkdir()
    text = find("stations", "example_hardware").read_text("utf-8").replace("[site]", f"[site]\n{site}")
    file.write_text(text, "utf-8")
    found = incompatibilities(link_test_configuration(LinkTestRequest(load_station(file)[1])))
    ids = [each.id for each in found if each.id in ("gravity_sigma_small", "gravity_normal")]
    assert ids == ([warning] if warning else [])


def test_imu_that_closes_the_connection_is_reported() -> None:
    def hang_up(_: bytes) -> bytes:
        raise OSError

    with server(hang_up) as address:
        assert wrong(imu(port=f"socket://{address}")).id == "lost"


def test_a_missing_profile_is_reported_in_one_sentence() -> None:
    with pytest.raises(ConfigurationError, match="There is no table profile “nosuch”"):
        table(profile="nosuch")


def test_ports_are_discovered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(list_ports, "comports", lambda: [])
    assert discover_ports(no_progress) == ()
