"""Registers of one type of unit are never written to another, and the list shows the types."""

import json
from collections.abc import Mapping
from pathlib import Path

import pytest
import tomli_w

from calstation.cli.app import run_app
from calstation.cli.commands.registers import largest_change
from calstation.config import RegisterOperation, library, load_configuration
from calstation.devices.imu import RegisterMap, TransferOutcome, TransferStep
from calstation.devices.profiles import RegisterEntry, load_imu_profile
from calstation.errors import DeviceFaultError, InputError
from calstation.registers import Transfer, moves_table, target_registers
from calstation.registers import journal as register_journal
from calstation.registers.journal import UnitType, map_digest
from calstation.results import Result
from calstation.runs import execute
from calstation.sequencer import Control
from tests.helpers import ignore_progress, raises_code
from tests.registers.operations import RegisterOperations
from tests.site_folder import STATION, SiteFolder

SERIAL = "SN-000042"
NAV, MEMS = "Bench IMU, navigation grade", "Bench IMU, MEMS grade"


def registers() -> list[RegisterEntry]:
    """Return the register map of the simulated units, which is equal for all grades."""
    return load_imu_profile(library.find("imus", "bench_nav")).registers


class JournalSite:
    """A site whose journal contains a transfer to a type of unit."""

    def __init__(self, site_folder: SiteFolder) -> None:
        self.site_folder = site_folder
        self.runs = site_folder.folder / "runs"
        self.own = register_journal.Purpose.of(load_configuration(site_folder.request()), "bench-imu", "", "").unit_type

    def transfer(
        self, sort: UnitType | None, old: Mapping[str, float] | None = None, *, open_: bool = False
    ) -> Transfer:
        names = RegisterMap(tuple(registers())).parameters
        old = dict.fromkeys(names, 1e-6) if old is None else old
        made = register_journal.begin(
            self.runs,
            SERIAL,
            old,
            dict.fromkeys(old, 2e-6),
            register_journal.Purpose("li", "hand", "", sort or UnitType()),
        )
        if not open_:
            made.note(TransferStep.COMMITTING)
            made.close(TransferOutcome.DONE)
        return made

    def restores(self) -> bool:
        """Return whether the latest set may be restored, as the command line checks before it opens a device."""
        return moves_table(RegisterOperation(self.site_folder.request(), "restore"))


@pytest.fixture
def journal_site(site_folder: SiteFolder) -> JournalSite:
    return JournalSite(site_folder)


def test_register_set_records_its_type_of_unit(journal_site: JournalSite) -> None:
    settled = RegisterOperations(journal_site.site_folder.request()).write({"gyro_bias_x": 2e-6}, at_rest=True)
    (entry,) = register_journal.history(journal_site.runs, SERIAL)
    assert entry.unit_type == UnitType(settled.unit["model"], NAV, "short", journal_site.own.map)
    assert journal_site.restores()


@pytest.mark.exhaustive
def test_run_records_the_type_of_unit_that_it_wrote(journal_site: JournalSite) -> None:
    assert journal_site.site_folder.run("rate").verdict.passed
    (entry,) = register_journal.history(journal_site.runs, SERIAL)
    assert (entry.unit_type.profile, entry.unit_type.product, entry.unit_type.map) == (
        NAV,
        "short",
        journal_site.own.map,
    )
    assert entry.unit_type.model.startswith("bench-imu")


@pytest.mark.parametrize(
    ("sort", "code"),
    [
        (UnitType("bench-imu", MEMS, "MEMS grade C", map_digest(registers())), "transfer.other_profile"),
        (UnitType("bench-imu", NAV, "short", "0123456789abcdef"), "transfer.other_meaning"),
    ],
)
@pytest.mark.parametrize("open_", [False, True])
def test_register_set_of_another_map_is_refused_before_any_device_is_opened(
    journal_site: JournalSite, sort: UnitType, code: str, open_: bool
) -> None:
    journal_site.transfer(sort, open_=open_)
    with raises_code(InputError, code):
        journal_site.restores()
    for what in ("finish", "restore"):
        with raises_code(InputError, code if open_ or what == "restore" else "transfer.nothing_to_finish"):
            RegisterOperations(journal_site.site_folder.request()).do(what)
    if open_:
        with raises_code(InputError, code):
            execute(journal_site.site_folder.request("rate"), lambda event: None, Control())
        assert list(journal_site.runs.glob("*.h5")) == []


@pytest.mark.parametrize("open_", [False, True])
def test_register_set_of_another_model_is_not_written(journal_site: JournalSite, open_: bool) -> None:
    journal_site.transfer(UnitType("other-imu", NAV, "short", journal_site.own.map), open_=open_)
    with raises_code(DeviceFaultError, "transfer.other_model"):
        RegisterOperations(journal_site.site_folder.request()).do("restore", at_rest=True)
    assert len(register_journal.history(journal_site.runs, SERIAL)) == 1


def test_a_register_set_without_a_type_is_compared_by_its_parameters(journal_site: JournalSite) -> None:
    journal_site.transfer(None)
    assert journal_site.restores()
    journal_site.transfer(None, {"gyro_bias_x": 1e-6})
    with raises_code(InputError, "transfer.other_parameters"):
        journal_site.restores()


def test_tolerance_does_not_change_the_identity_of_a_register_map(journal_site: JournalSite) -> None:
    entries = registers()
    near = [entry.model_copy(update={"tolerance": 1e-9}) for entry in entries]
    turned = [entry.model_copy(update={"scale": -entry.scale}) for entry in entries]
    assert map_digest(near) == journal_site.own.map
    assert map_digest(turned) != journal_site.own.map


def test_a_result_of_another_profile_is_not_offered_to_the_unit(journal_site: JournalSite) -> None:
    result = {
        "unit": {"serial": SERIAL},
        "product": "MEMS grade C",
        "configuration": {"imu": {"name": "bench_mems", "version": None, "sha256": ""}},
        "parameters": {"gyro_bias_x": {"value": 1e-6, "sigma": 0.0}},
        "schema": "calstation.result/1",
        "stages": [],
        "outcome": "passed",
        "log": {"file": ""},
    }
    with raises_code(InputError, "transfer.result_other_profile"):
        target_registers(ignore_progress, journal_site.site_folder.request(), Result.from_json(result))


def test_registers_are_not_written_from_unjudged_parameters(journal_site: JournalSite) -> None:
    result = {
        "unit": {"serial": SERIAL},
        "parameters": {"gyro_bias_x": {"value": 1e-6, "sigma": 0.0}},
        "tested": False,
        "schema": "calstation.result/1",
        "stages": [],
        "outcome": "resolved",
        "log": {"file": ""},
    }
    with raises_code(InputError, "transfer.result_untested"):
        target_registers(ignore_progress, journal_site.site_folder.request(), Result.from_json(result))


def test_registers_of_a_real_unit_are_not_written_from_a_simulated_result(journal_site: JournalSite) -> None:
    result = {
        "unit": {"serial": SERIAL},
        "parameters": {"gyro_bias_x": {"value": 1e-6, "sigma": 0.0}},
        "simulated": True,
        "schema": "calstation.result/1",
        "stages": [],
        "outcome": "passed",
        "log": {"file": ""},
    }
    simulated, site = Result.from_json(result), journal_site.site_folder
    assert target_registers(ignore_progress, site.request(), simulated).values["gyro_bias_x"]
    ports = {"table": {"profile": "bench", "port": "tcp://127.0.0.1:9"}, "imu": {"port": "socket://127.0.0.1:9"}}
    site.station.write_text(tomli_w.dumps({**STATION, **ports}), encoding="utf-8")
    with raises_code(InputError, "transfer.result_simulated"):
        target_registers(ignore_progress, site.request(), simulated)
    assert target_registers(ignore_progress, site.request(), Result.from_json({**result, "simulated": False})).values


def test_largest_change_is_relative_to_the_expected_change(journal_site: JournalSite) -> None:
    old = {"gyro_bias_x": 0.0, "gyro_scale_x": 0.0, "accel_bias_x": 1e-3}
    new = {"gyro_bias_x": 2e-5, "gyro_scale_x": 2e-3, "accel_bias_x": 1.1e-3}

    def largest(profile: str) -> str | None:
        made = register_journal.begin(
            journal_site.runs, SERIAL, old, new, register_journal.Purpose(None, "run", "", UnitType("", profile))
        )
        return largest_change(made)

    assert largest(NAV) == "gyro_scale_x", "a whole sigma; a bias near its limit is 0.8 of one"
    assert largest(MEMS) == "gyro_scale_x"
    new["gyro_bias_x"] = 5e-5
    assert largest(NAV) == "gyro_bias_x"
    assert largest(MEMS) == "gyro_scale_x"
    assert largest("a profile that is gone") == "gyro_scale_x"
    new |= old
    assert largest(NAV) is None


@pytest.mark.parametrize(
    ("language", "texts"),
    [
        ("en", ("by Kim, written by hand with the values of SN-1.csv", ", written by hand\n", "restored from a.csv")),
        ("zh_CN", ("操作者 Kim，手动写入 SN-1.csv 的值", "，手动写入\n", "恢复自 a.csv")),
    ],
)
def test_list_states_why_registers_were_written(
    journal_site: JournalSite,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    language: str,
    texts: tuple[str, ...],
) -> None:
    monkeypatch.setattr("calstation.cli.text.LANGUAGE", language)
    for by, why, source in (("Kim", "hand", "SN-1.csv"), (None, "hand", ""), (None, "restore", "a.csv")):
        purpose = register_journal.Purpose(by, why, source, journal_site.own)
        register_journal.begin(journal_site.runs, SERIAL, {}, {}, purpose).close(TransferOutcome.KEPT)
    assert run_app(["registers", "list", "--out", str(journal_site.runs)]) == 0
    output = capsys.readouterr().out
    assert all(text in output for text in texts)


def test_hardware_and_simulated_units_are_listed_separately(
    journal_site: JournalSite, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    home = tmp_path / "home"
    monkeypatch.setenv("CALSTATION_HOME", str(home))
    journal_site.transfer(UnitType("bench-imu", MEMS, "MEMS grade C"))
    for _ in range(2):
        made = register_journal.begin(home, SERIAL, {}, {}, register_journal.Purpose(None, "run", "", journal_site.own))
        made.note(TransferStep.COMMITTING)
        made.close(TransferOutcome.KEPT)
    assert run_app(["registers", "list", "--out", str(journal_site.runs)]) == 0
    output = capsys.readouterr().out
    assert f"unit {SERIAL} on hardware, 2 flash cycles" in output
    assert f"unit {SERIAL} on the virtual bench, 1 flash cycle" in output
    assert f"a bench-imu, with IMU profile '{MEMS}' of product 'MEMS grade C'" in output
    assert run_app(["registers", "list", SERIAL, "--out", str(journal_site.runs), "--json", "-"]) == 0
    listed = json.loads(capsys.readouterr().out)[SERIAL]
    assert {kind: found["flash_cycles"] for kind, found in listed.items()} == {"hardware": 2, "virtual": 1}
    (row,) = listed["virtual"]["transfers"]
    assert (row["station"], row["model"], row["profile"]) == ("virtual", "bench-imu", MEMS)
    assert run_app(["registers", "list", "SN-000099", "--out", str(journal_site.runs)]) == 0
    assert "No transfer is known" in capsys.readouterr().out
