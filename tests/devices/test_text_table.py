"""Text table drivers tested with request and reply bytes: ATL with a prompt, plain ACL, $MN with checksums."""

import math
import re
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.devices import UNKNOWN_FAULT, OtherModelError
from calstation.devices.links import TextRefusalError, text_link
from calstation.devices.links.text_link import ChecksummedFraming, PlainFraming, PromptedFraming
from calstation.devices.profiles import TableProfile, load_table_profile
from calstation.devices.table import TextTable
from calstation.errors import ConfigurationError, DeviceFaultError
from tests.connection.fake_links import server, terminal
from tests.devices.scripted import ScriptedDevice
from tests.helpers import raises_code

TABLES = Path(__file__).parents[2] / "data" / "tables"
Pairs = list[tuple[bytes, bytes]]


def profile(name: str, **text: Any) -> TableProfile:
    found = load_table_profile(TABLES / f"{name}.toml")
    assert found.text is not None
    return found.model_copy(update={"text": found.text.model_copy(update={"timeout_s": 0.3, **text})})


@contextmanager
def over_tcp(device: ScriptedDevice) -> Iterator[str]:
    with server(device.answer, device.connected) as address:
        yield f"tcp://{address}"


def over_terminal(device: ScriptedDevice) -> AbstractContextManager[str]:
    return terminal(device.answer)


@contextmanager
def table(pairs: Pairs, used: TableProfile, place: Any = over_tcp) -> Iterator[tuple[TextTable, ScriptedDevice]]:
    line = ScriptedDevice(pairs)
    with place(line) as port:
        driver = TextTable(port, used)
        try:
            yield driver, line
        finally:
            driver.close()
    assert line.finished


# ATL -------------------------------------------------------------------------------------------------------------

ATL_STATE: Pairs = [
    (b"1STA\r\n", b"43 0\r\n>"),
    (b"2STA\r\n", b"2STA\r\n43 0\r\n>"),
    (b"1PPO\r\n", b"-45.0000\r\n>"),
    (b"2PPO\r\n", b"360.0001\r\n>"),
    (b"1PVE\r\n", b"0.0\r\n>"),
    (b"2PVE\r\n", b"-0.0005\r\n>"),
]
places = pytest.mark.parametrize(
    "place",
    [over_tcp, pytest.param(over_terminal, marks=pytest.mark.skipif(sys.platform == "win32", reason="terminals"))],
)


@places
def test_atl_requests_match_the_protocol(place: Any) -> None:
    pairs: Pairs = [
        (b"IDN\r\n", b"AERO 4000,SN77\r\n>"),
        *ATL_STATE,
        (b"1SRV1\r\n", b">"),
        (b"2SRV1\r\n", b"1>"),
        (b"1HOM\r\n", b">"),
        (b"2HOM\r\n", b">"),
        (b"1ACL40.0000\r\n", b">"),
        (b"2ACL40.0000\r\n", b">"),
        (b"1VEL20.0000\r\n", b">"),
        (b"2VEL20.0000\r\n", b">"),
        (b"1MOV-90.0000\r\n", b">"),
        (b"2MOV720.0000\r\n", b">"),
        (b"1STO\r\n", b">"),
        (b"2STO\r\n", b">"),
        (b"1SRV0\r\n", b">"),
        (b"2SRV0\r\n", b">"),
        (b"1CLR\r\n", b">"),
        (b"2CLR\r\n", b">"),
    ]
    with table(pairs, profile("aerosmith_atl"), place) as (driver, _):
        identity = driver.identify()
        assert (identity.model, identity.serial) == ("AERO 4000", "SN77")
        status = driver.status()
        np.testing.assert_allclose(status.angles, np.deg2rad([-45.0, 360.0001]), atol=1e-12)
        np.testing.assert_allclose(status.rates, np.deg2rad([0.0, -0.0005]))
        assert (status.enabled, status.homed, status.moving, status.settled) == (True, True, False, True)
        assert status.fault is None
        assert status.interlock_closed
        assert math.isinf(status.watchdog), "it has none that must be fed"
        driver.enable()
        driver.home()
        driver.move(*np.deg2rad([-90.0, 720.0, 20.0, 40.0]))
        driver.heartbeat()
        driver.stop()
        driver.disable()
        driver.reset_fault()


def test_atl_fault_is_reported_by_its_code() -> None:
    faulty = [(b"1STA\r\n", b"26 3\r\n>"), *ATL_STATE[1:]]
    with table([*faulty, (b"1STA\r\n", b"26 9\r\n>"), *ATL_STATE[1:]], profile("aerosmith_atl")) as (driver, _):
        status = driver.status()
        assert (status.fault, status.enabled, status.interlock_closed) == ("limit", False, False)
        assert driver.status().fault == "code 9"


def test_atl_late_jog_prompt_is_never_taken_for_an_angle() -> None:
    stated = profile("aerosmith_atl").model_copy(update={"link_loss_stop_s": 1.0})
    pairs: Pairs = [
        *ATL_STATE,
        (b"1ACL20.0000\r\n", b">"),
        (b"2ACL20.0000\r\n", b">"),
        (b"1JOG5.0000\r\n", b""),
        (b"1STA\r\n", b">47 0\r\n>"),
        (b"2JOG-2.5000\r\n", b""),
        (b"1STA\r\n", b"JOG OK\r\n>47 0\r\n>"),
        *ATL_STATE,
    ]
    with table(pairs, stated) as (driver, _):
        driver.rate(*np.deg2rad([5.0, -2.5, 20.0]))
        assert driver.status().angles[0] == pytest.approx(np.deg2rad(-45.0))


@pytest.mark.parametrize("name", ["aerosmith_atl", "acutronic_acl", "mn_ascii"])
def test_continuous_rotation_is_refused_without_a_watchdog(name: str) -> None:
    answers = {"aerosmith_atl": ATL_STATE, "acutronic_acl": ACL_STATE, "mn_ascii": MN_STATE}[name]
    with table(answers, profile(name)) as (driver, _), raises_code(ConfigurationError, "table.would_not_stop"):
        driver.rate(0.1, 0.0, 0.1)


@pytest.mark.parametrize(
    ("rates", "code"),
    [((121.0, 0.0, 10.0), "table.rate_above_limit"), ((1.0, 1.0, 101.0), "table.acceleration_outside_limits")],
)
def test_continuous_rotation_outside_the_profile_limits_is_refused(rates: tuple[float, ...], code: str) -> None:
    stated = profile("aerosmith_atl").model_copy(update={"link_loss_stop_s": 1.0})
    with table(ATL_STATE, stated) as (driver, _), raises_code(ConfigurationError, code):
        driver.rate(*np.deg2rad(rates))


def test_atl_error_reply_is_reported_and_the_request_not_repeated() -> None:
    with (
        table([(b"1SRV1\r\n", b"ERROR 7\r\n>")], profile("aerosmith_atl")) as (driver, _),
        raises_code(TextRefusalError, "table.line_refused"),
    ):
        driver.enable()


IDENTITY: Pairs = [(b"IDN\r\n", b"AERO 4000,SN77\r\n>")]
LOST, STOP = (b"1STO\r\n", b""), [(b"1STO\r\n", b">")]


def test_request_with_a_lost_reply_is_repeated_on_a_new_socket_except_homing() -> None:
    pairs = [LOST, *IDENTITY, LOST, *IDENTITY, *STOP, (b"2STO\r\n", b">"), (b"1HOM\r\n", b"")]
    with table(pairs, profile("aerosmith_atl")) as (driver, line):
        driver.stop()
        with raises_code(DeviceFaultError, "table.line_unanswered"):
            driver.home()
        assert line.connections == 3


@pytest.mark.skipif(sys.platform == "win32", reason="terminals")
def test_stop_is_sent_immediately_while_other_replies_are_pending() -> None:
    second: Pairs = [(b"2STO\r\n", b">"), *IDENTITY, (b"2STO\r\n", b">")]
    with table([LOST, LOST, *STOP, *second, (b"1HOM\r\n", b"")], profile("aerosmith_atl"), over_terminal) as (
        driver,
        _,
    ):
        driver.stop()
        with raises_code(DeviceFaultError, "table.line_unanswered"):
            driver.home()


@pytest.mark.skipif(sys.platform == "win32", reason="terminals")
def test_late_reply_is_not_taken_for_another_axis_or_command() -> None:
    state = ATL_STATE[:2]
    late = [(b"1PPO\r\n", b""), (b"IDN\r\n", b"1.0000\r\n>AERO 4000,SN77\r\n>"), (b"1PPO\r\n", b"-45.0\r\n>")]
    with table([*state, *late, *ATL_STATE[3:]], profile("aerosmith_atl"), over_terminal) as (driver, _):
        np.testing.assert_allclose(driver.status().angles, np.deg2rad([-45.0, 360.0001]), atol=1e-12)
    homing = [(b"1HOM\r\n", b""), (b"IDN\r\n", b">ERROR 7\r\n>AERO 4000,SN77\r\n>"), (b"1HOM\r\n", b"")]
    with table(homing, profile("aerosmith_atl"), over_terminal) as (driver, _):
        for _ in range(2):
            with raises_code(DeviceFaultError, "table.line_unanswered"):
                driver.home()


def test_a_reopened_link_must_lead_to_the_same_table() -> None:
    other: Pairs = [(b"IDN\r\n", b"AERO 4000,SN78\r\n>")]
    with table([*IDENTITY, LOST, *other], profile("aerosmith_atl")) as (driver, _):
        driver.identify()
        with raises_code(DeviceFaultError, "table.other_table"):
            driver.stop()


def test_an_unexpected_reply_is_reported_with_its_entry() -> None:
    with (
        table([(b"1STA\r\n", b"ready\r\n>")], profile("aerosmith_atl")) as (driver, _),
        raises_code(DeviceFaultError, "table.unexpected_answer"),
    ):
        driver.status()


def test_another_model_is_refused() -> None:
    other = profile("aerosmith_atl").model_copy(update={"model": "AERO 812"})
    with (
        table([(b"IDN\r\n", b"AERO 4000,1\r\n>")], other) as (driver, _),
        raises_code(OtherModelError, "table.other_model"),
    ):
        driver.identify()


# ACL -------------------------------------------------------------------------------------------------------------

ACL_STATE: Pairs = [
    (b":Interlock? 1\n", b"Closed\n"),
    (b":Interlock? 2\n", b"INTERLOCK Closed\n"),
    (b":Mode? 1\n", b"Position\n"),
    (b":Mode? 2\n", b"Off\n"),
    (b":Read:Pos? 1\n", b"12.5000\n"),
    (b":Read:Pos? 2\n", b":READ:POS -7.25\n"),
    (b":Limit:Absolute? 1\n", b"1000,8300,100000,-720,720,1100\n"),
    (b":Limit:Absolute? 2\n", b"1000,8300,100000,-1080,1080,1100\n"),
    (b":Read:Rate? 1\n", b"0.0001\n"),
    (b":Read:Rate? 2\n", b"0\n"),
]


def confirmed(line: bytes) -> Pairs:
    """Return a command followed by the query that confirms its reception."""
    return [(line, b""), (b":Mode? 1\n", b"Position\n")]


@places
def test_acl_requests_match_the_protocol(place: Any) -> None:
    pairs: Pairs = [
        (b"*IDN?\n", b"ACUTRONIC SCHWEIZ,ACU 2000,A-5,2.1\n"),
        *ACL_STATE,
        *confirmed(b":Int:Close 1\n"),
        *confirmed(b":Int:Close 2\n"),
        *confirmed(b":Mode:Pos 1\n"),
        *confirmed(b":Mode:Pos 2\n"),
        *confirmed(b":Lim:Acc pos,1,40.00000\n"),
        *confirmed(b":Lim:Acc pos,2,40.00000\n"),
        *confirmed(b":Lim:Rate pos,1,20.00000\n"),
        *confirmed(b":Lim:Rate pos,2,20.00000\n"),
        *confirmed(b":Mode:Pos 1\n"),
        *confirmed(b":Mode:Pos 2\n"),
        *confirmed(b":Dem:Pos 1,-90.00000\n"),
        *confirmed(b":Dem:Pos 2,0.00000\n"),
        *confirmed(b":Mode:Rate 1\n"),
        *confirmed(b":Mode:Rate 2\n"),
        *confirmed(b":Dem:Rate 1,0\n"),
        *confirmed(b":Dem:Rate 2,0\n"),
        *confirmed(b":Mode:Off 1\n"),
        *confirmed(b":Mode:Off 2\n"),
        *confirmed(b":Int:Open 1\n"),
        *confirmed(b":Int:Open 2\n"),
        *confirmed(b":Interlock:Reset\n"),
        *ACL_STATE,
    ]
    with table(pairs, profile("acutronic_acl"), place) as (driver, _):
        assert driver.identify().model == "ACUTRONIC SCHWEIZ,ACU 2000"
        status = driver.status()
        np.testing.assert_allclose(status.angles, np.deg2rad([12.5, -7.25]))
        np.testing.assert_allclose(status.limits.high, np.deg2rad([720.0, 1080.0]))
        np.testing.assert_allclose(status.limits.low, np.deg2rad([-720.0, -1080.0]))
        assert (status.enabled, status.homed, status.moving, status.settled) == (True, True, False, False)
        assert status.fault is None
        driver.enable()
        driver.move(np.deg2rad(-90.0), -1e-9, *np.deg2rad([20.0, 40.0]))
        driver.stop()
        driver.disable()
        driver.reset_fault()
        driver.status()
        with raises_code(ConfigurationError, "table.no_home_command"):
            driver.home()


def test_acl_table_is_settled_when_the_angles_stop_changing() -> None:
    quick = profile("acutronic_acl", settled_polls=3)
    moved = [(b":Read:Pos? 1\n", b"12.6\n") if b"Pos? 1" in q else (q, a) for q, a in ACL_STATE]
    with table([*ACL_STATE * 4, *moved, *moved], quick) as (driver, _):
        assert [driver.status().settled for _ in range(4)] == [False, False, False, True]
        assert not driver.status().settled
        assert not driver.status().settled


def test_acl_reports_a_fault_and_a_moving_axis() -> None:
    answers = dict(ACL_STATE)
    answers[b":Interlock? 2\n"] = b"Fault\n"
    answers[b":Read:Rate? 1\n"] = b"-5.5\n"
    with table(list(answers.items()), profile("acutronic_acl")) as (driver, _):
        status = driver.status()
        assert (status.fault, status.enabled, status.moving) == (UNKNOWN_FAULT, False, True)


# $MN -------------------------------------------------------------------------------------------------------------


def mn(head: str, words: str) -> bytes:
    return f"${head}{words}*{sum(words.encode()) & 0xFF:02X}\r\n".encode()


def pair(request: str, reply: str) -> tuple[bytes, bytes]:
    return mn("MN", request), mn("AS", reply)


MN_STATE: Pairs = [pair("STS,0", "STS,OK,-45.00000,0.00000,360.00010,-2.00000,004F,0")]


@places
def test_mn_requests_match_the_protocol(place: Any) -> None:
    each = [
        "REM", "ENB,1", "ENB,2", "HMZ,1", "HMZ,2", "MOD,1,POS", "MOD,2,POS", "ACC,1,40.00000", "ACC,2,40.00000",
        "VEL,1,20.00000", "VEL,2,20.00000", "POS,1,-90.00000", "POS,2,720.00000", "RUN,1", "RUN,2", "STP,1", "STP,2",
        "DIS,1", "DIS,2", "CLR",
    ]  # fmt: skip
    commands = [pair(words, f"{words[:3]},OK") for words in each]
    pairs: Pairs = [pair("CHK", "CHK,OK,MN-3A,T9"), *MN_STATE, *commands]
    with table(pairs, profile("mn_ascii"), place) as (driver, _):
        assert driver.identify().serial == "T9"
        status = driver.status()
        np.testing.assert_allclose(status.angles, np.deg2rad([-45.0, 360.0001]), atol=1e-12)
        np.testing.assert_allclose(status.rates, np.deg2rad([0.0, -2.0]))
        assert (status.enabled, status.homed, status.moving, status.settled) == (True, True, True, True)
        assert not status.interlock_closed
        driver.enable()
        driver.home()
        driver.move(*np.deg2rad([-90.0, 720.0, 20.0, 40.0]))
        driver.stop()
        driver.disable()
        driver.reset_fault()


def test_mn_checksums_match_known_values() -> None:
    section = profile("mn_ascii").text
    assert section is not None
    assert section.checked is not None
    framing = ChecksummedFraming(section, section.checked)
    assert framing.request("CHK") == b"$MNCHK*D6\r\n"
    headed = ChecksummedFraming(section, section.checked.model_copy(update={"counts_head": True}))
    assert headed.request("CHK") == b"$MNCHK*95\r\n"
    assert headed.reply("CHK", b"$ASCHK,OK*54\r\n") == ("CHK,OK", b"")


def test_mn_wrong_checksum_error_reply_and_unrelated_reply_are_handled() -> None:
    request, reply = pair("STP,1", "STP,OK")
    other = pair("STP,2", "STP,OK")
    hurt = reply.replace(b"OK", b"OO")
    late = mn("AS", "RUN,OK")
    who = pair("CHK", "CHK,OK,MN-3A,T9")
    pairs = [(request, hurt), who, (request, late + b"noise\r\n" + reply), other]
    with table(pairs, profile("mn_ascii")) as (driver, _):
        driver.stop()
    with (
        table([(request, mn("AS", "STP,ERR,4"))], profile("mn_ascii")) as (driver, _),
        raises_code(TextRefusalError, "table.line_refused"),
    ):
        driver.stop()


def test_mn_local_control_is_reported() -> None:
    local = [pair("STS,0", "STS,OK,0.0,0.0,0.0,0.0,002F,0")]
    with table(local, profile("mn_ascii")) as (driver, _):
        assert driver.status().fault == "local control"


# All text tables -------------------------------------------------------------------------------------------------


def test_lost_table_is_reported_and_reconnected() -> None:
    request, reply = pair("CHK", "CHK,OK,MN-2A,T1")
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer_once_each() -> None:
            with suppress(OSError):
                while True:
                    peer, _ = server.accept()
                    with peer:
                        assert peer.recv(100) == request
                        peer.sendall(reply)

        threading.Thread(target=answer_once_each, daemon=True).start()
        driver = TextTable(f"tcp://127.0.0.1:{server.getsockname()[1]}", profile("mn_ascii"))
        assert driver.identify().serial == "T1"
        with raises_code(DeviceFaultError, "link.lost"):
            driver.identify()
        assert driver.identify().serial == "T1"
        driver.close()
        with suppress(OSError):
            server.shutdown(socket.SHUT_RDWR)


def test_a_missing_port_is_reported() -> None:
    with raises_code(DeviceFaultError, "link.nothing_served"):
        TextTable("tcp://127.0.0.1:1", profile("acutronic_acl"))


@given(noise=st.lists(st.one_of(st.binary(max_size=30), st.sampled_from([b"\r\n", b">", b"$AS", b"*D6"])), max_size=20))
def test_noise_does_not_break_the_framing(noise: list[bytes]) -> None:
    heard = b"".join(noise)
    for name in ("aerosmith_atl", "acutronic_acl", "mn_ascii"):
        section = profile(name).text
        assert section is not None
        framing = (
            ChecksummedFraming(section, section.checked)
            if section.checked
            else (PromptedFraming if section.prompt else PlainFraming)(section)
        )
        rest = heard
        while (found := framing.reply("STP,1", rest)) is not None:
            assert len(found[1]) < len(rest)
            rest = found[1]


def test_query_after_unanswered_lines_has_another_form_of_reply_than_these(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_link, "SerialLink", lambda *arguments: ScriptedDevice(()))
    section = profile("acutronic_acl").text
    assert section is not None
    link = text_link.TextLink("LINE", section, section.serial)
    number, limits = (re.compile(section.queries[name].answer) for name in ("position", "limits"))
    letters = {":Interlock? 1", ":Mode? 1"}
    link._unanswered = {":Read:Pos? 2": number}
    assert not [*link._distinct_lines()], "an unknown reply may look like any other"
    link._replies = {":Read:Pos? 2": "1.5"}
    assert {*link._distinct_lines()} == {"*IDN?", ":Limit:Absolute? 1", *letters}
    link._unanswered, link._replies = {":Limit:Absolute? 1": limits}, {":Limit:Absolute? 1": "-1.0,1.0,0.0"}
    assert {*link._distinct_lines()} == {"*IDN?", *letters}, "the last number of the limits looks like a position"
