"""The text protocols of the simulated table: documented replies, and moves by their drivers over TCP and serial."""

import sys
from pathlib import Path

import numpy as np
import pytest

from calstation.bench.table import LANGUAGES, Axes, Clocks, Fault, TableLimits, TableMachine
from calstation.bench.truth import EncoderTruth, TableDrive
from calstation.devices import UNKNOWN_FAULT
from calstation.devices.links import TextRefusalError
from calstation.devices.profiles import load_table_profile
from calstation.devices.table import TextTable

TABLES = Path(__file__).parents[2] / "data" / "tables"
PROFILES = {"atl": "aerosmith_atl", "acl": "acutronic_acl", "mn": "mn_ascii"}
posix = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals")
tables = pytest.mark.parametrize("language", PROFILES)


class Controller:
    """A controller of one text protocol over an error-free table; time advances only on request."""

    def __init__(self, language, start=(0.0, 0.0)):
        limits = TableLimits(low=(-2.0, -4.0), high=(2.0, 4.0))
        self.machine = TableMachine(TableDrive(EncoderTruth(0.0, 0.0, (0.0, 0.0), 0.0), start), limits)
        self.time = 0.0
        clocks = Clocks(self.now, self.now, self.now)
        self._controller = LANGUAGES[language](Axes(self.machine, clocks), "T-9")

    def now(self):
        return self.time

    def __call__(self, *lines, end="\r\n"):
        return b"".join(self._controller.feed("".join(line + end for line in lines).encode())).decode()


def mn(words):
    return f"$MN{words}*{sum(words.encode()) & 0xFF:02X}"


def test_atl_replies_match_the_protocol():
    table = Controller("atl")
    assert table("IDN") == "AERO 4000,T-9\r\n>"
    assert table("1STA") == "104 0\r\n>"
    assert table("1PPO") == "0.0000\r\n>"
    assert table("1MOV90") == "?ERR\r\n>"
    assert table("1FOO", "", "3STA") == "?ERR\r\n>" * 3
    assert table("1SRV1", "2SRV1", "1HOM", "2HOM") == ">>>>"
    table.time = 1.0
    table.machine.advance(1.0)
    assert table("1STA") == "107 0\r\n>"
    assert table("1ACL20", "1VEL20", "1MOV90") == ">>>"
    assert table("2MOV45") == ">", "the other axis may start while the first moves"
    table.time = 3.0
    assert table("1STA") == "103 0\r\n>"
    table.machine.set_interlock(False, 3.0)
    assert table("1STA") == "86 1\r\n>"


def test_atl_jog_reply_comes_with_the_next_line():
    table = Controller("atl")
    table("1SRV1", "2SRV1", "1HOM")
    table.time = 1.0
    table.machine.advance(1.0)
    assert table("1JOG5") == ""
    assert table("1STA") == ">103 0\r\n>"
    table.time = 3.0
    assert float(table("1PVE").split()[0]) == pytest.approx(5.0, abs=0.01)
    assert table("1STO") == ">"


def test_acl_replies_match_the_protocol():
    table = Controller("acl")
    assert table("*IDN?", end="\n") == "ACUTRONIC SCHWEIZ,ACU 2000,T-9,1.0\n"
    assert table(":Interlock? 1", ":Mode? 2", ":Read:Pos? 1", end="\n") == "Open\nOff\n0.00000\n"
    assert table(":Limit:Absolute? 1", end="\n") == "120,200,10000,-114.592,114.592,1000\n"
    assert table(":Dem:Pos 1,30", "*STB?", "*STB?", end="\n") == "65\n0\n", "not in position mode"
    assert table(":Int:Close 1", ":Int:Close 2", ":Interlock? 1", end="\n") == "Closed\n"
    table.machine.trip(Fault.DRIVE, 0.0)
    assert table(":Interlock? 1", "*STB?", end="\n") == "Fault\n65\n"
    assert table(":Interlock:Reset", ":Interlock? 1", end="\n") == "Open\n"


def test_mn_replies_match_the_protocol():
    table = Controller("mn")
    assert table(mn("CHK")) == "$ASCHK,OK,MN-2A,T-9*E9\r\n"
    assert table("$MNCHK*00", "CHK", "$MN*", mn("STS,0").lower()) == "", "what has no right sum is not answered"
    assert table(mn("RUN,1")).startswith("$ASRUN,ERR*")
    assert table(mn("ENB,7")).startswith("$ASENB,ERR*")
    assert table(mn("STS,0")).startswith("$ASSTS,OK,0.00000,0.00000,0.00000,0.00000,0068,0*")


@tables
def test_controller_survives_arbitrary_bytes(language):
    table = Controller(language)
    random = np.random.default_rng(3)
    for _ in range(200):
        data = bytes(random.integers(0, 256, 40, dtype=np.uint8))
        assert all(len(reply) < 200 for reply in table._controller.feed(data + b"\r\n1MOV\xff,?:;*$MN\n"))
    assert len(table._controller.feed(b"x" * 100_000)) == 0


@tables
@pytest.mark.parametrize("transport", ["tcp", pytest.param("rtu", marks=posix)])
def test_driver_moves_the_simulated_table(start_bench, language, transport):
    profile = load_table_profile(TABLES / f"{PROFILES[language]}.toml").at_station(2.0, None)
    settings = {"table_protocol": language, "table_transport": transport, "start_deg": [2.0, -1.0], "speed": 0.0}
    with start_bench(table_serial="T-42", encoder_sigma_deg=0.0, encoder_periodic_deg=0.0, **settings) as bench:
        at = bench.endpoints["table"]
        table = TextTable(f"tcp://{at}" if transport == "tcp" else at, profile)
        try:
            assert table.identify().serial == "T-42"
            status = table.status()
            assert (status.enabled, status.moving, status.fault) == (False, False, None)
            table.enable()
            if not table.status().homed:
                table.home()
                bench.advance(6.0)
            assert table.status().homed
            assert table.status().enabled
            table.move(*np.deg2rad([30.0, -15.0, 20.0, 40.0]))
            bench.advance(0.5)
            status = table.status()
            assert status.moving
            assert not status.settled
            assert abs(status.rates[0]) > 0.1
            bench.advance(3.0)
            for _ in range(8):
                bench.advance(0.05)
                status = table.status()
            assert (status.moving, status.settled) == (False, True)
            np.testing.assert_allclose(np.rad2deg(status.angles), [30.0, -15.0], atol=0.01)
            table.move(*np.deg2rad([-60.0, 15.0, 20.0, 40.0]))
            bench.advance(1.0)
            table.stop()
            bench.advance(2.0)
            angles = np.rad2deg(table.status().angles)
            assert 0.0 < angles[0] < 29.0
            bench.ask(order="interlock", value=0.0)
            assert table.status().fault in ("interlock", UNKNOWN_FAULT)
            assert not table.status().enabled
            bench.ask(order="interlock", value=1.0)
            table.reset_fault()
            status = table.status()
            assert (status.fault, status.enabled) == (None, False)
            np.testing.assert_allclose(np.rad2deg(status.angles), angles, atol=0.01)
        finally:
            table.close()


@pytest.mark.long
@tables
def test_requests_with_lost_replies_are_repeated(start_bench, language):
    profile = load_table_profile(TABLES / f"{PROFILES[language]}.toml").at_station(0.3, None)
    with start_bench(table_protocol=language) as bench:
        table = TextTable(f"tcp://{bench.endpoints['table']}", profile)
        try:
            bench.ask(order="mute_table", value=2.0)
            assert table.identify().serial == "T-0001"
        finally:
            table.close()


def test_rejected_command_is_reported(start_bench):
    with start_bench(table_protocol="mn") as bench:
        table = TextTable(f"tcp://{bench.endpoints['table']}", load_table_profile(TABLES / "mn_ascii.toml"))
        try:
            with pytest.raises(TextRefusalError, match="refused with 'RUN,ERR'"):
                table.move(0.1, 0.1, 0.1, 0.1)
        finally:
            table.close()


@pytest.mark.parametrize("language", ["atl", "mn", "acl"])
def test_continuous_rotation_is_allowed_if_the_profile_states_a_stop_time(start_bench, language):
    profile = load_table_profile(TABLES / f"{PROFILES[language]}.toml").model_copy(update={"link_loss_stop_s": 1.0})
    with start_bench(table_protocol=language, start_deg=[0.0, 0.0]) as bench:
        table = TextTable(f"tcp://{bench.endpoints['table']}", profile)
        try:
            table.enable()
            if not table.status().homed:
                table.home()
            bench.advance(6.0)
            table.rate(np.deg2rad(10.0), np.deg2rad(-5.0), np.deg2rad(40.0))
            bench.advance(3.0)
            np.testing.assert_allclose(np.rad2deg(table.status().rates), [10.0, -5.0], atol=0.1)
            table.stop()
            bench.advance(2.0)
            np.testing.assert_allclose(table.status().rates, [0.0, 0.0], atol=1e-3)
        finally:
            table.close()
