"""The slots of a station, and the requests and configurations of the units in a batch."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from calstation.bench import BenchConfig
from calstation.config import (
    RunRequest,
    StationConfig,
    at_slot,
    check,
    library,
    load_station,
    new_batch_id,
    unit_requests,
)
from calstation.config.editing import check_data
from calstation.connection import station_conflicts
from calstation.errors import ConfigurationError
from calstation.physics import orientation_matrix
from calstation.schema import validate
from calstation.sequencer import table_task, unit_task
from calstation.simulation import bench_config
from calstation.simulation.fault_plan import with_faults
from tests.helpers import error_code, raises_code
from tests.prepared import prepare_batch, prepare_run
from tests.site_folder import BENCH, PRODUCT, STATION, SiteFolder

PORTS = ("/dev/ttyUSB1", "/dev/ttyUSB2")
SLOTS = [{"name": name, "port": port} for name, port in zip(("A", "B"), PORTS, strict=True)]
HARDWARE = {**STATION, "table": {"profile": "bench", "port": "tcp://127.0.0.1:502"}, "slots": SLOTS}
PLACES: list[dict[str, Any]] = [
    {"name": "left"},
    {"name": "right", "orientation": "-y+z", "lever_m": [0.1, -0.2, 0.0]},
    {"name": "top"},
]


def write(site_folder: SiteFolder, **changes: Any) -> None:
    """Write a station with three slots on the bench."""
    site = {**STATION["site"], "gravity_mps2": 9.79547}
    station = {**STATION, "site": site, "bench": BENCH, "slots": PLACES, **changes}
    site_folder.station.write_text(tomli_w.dumps({k: v for k, v in station.items() if v is not None}), encoding="utf-8")


def batch(site_folder: SiteFolder, *serials: str) -> RunRequest:
    return replace(site_folder.request(), serial=next(filter(None, serials), ""), serials=serials)


@pytest.mark.parametrize(
    ("changes", "entry", "code"),
    [
        ({"imu": {"port": "/dev/ttyUSB3"}}, "imu", "station.slots_and_imu"),
        ({"slots": [SLOTS[0], {**SLOTS[1], "name": "A"}]}, "slots[2].name", "station.slot_twice"),
        ({"slots": [SLOTS[0], {**SLOTS[1], "port": PORTS[0]}]}, 'slots["B"].port', "station.slot_twice"),
        ({"slots": [SLOTS[0], {"name": "B"}]}, 'slots["B"].port', "station.port_missing"),
        ({"slots": [{**SLOTS[0], "port": "127.0.0.1:5"}]}, 'slots["A"].port', "station.imu_scheme_missing"),
        ({"slots": [{**SLOTS[0], "port": "tcp://127.0.0.1:5"}]}, 'slots["A"].port', "station.imu_over_modbus"),
        ({"slots": [{**SLOTS[0], "orientation": "+x-x"}]}, 'slots["A"].orientation', "station.one_axis_twice"),
        ({"slots": [{**SLOTS[0], "orientation": "x+z"}]}, 'slots["A"].orientation', "station.not_an_orientation"),
        ({"slots": [{**SLOTS[0], "name": "slot 1"}]}, 'slots["slot 1"].name', "station.slot_name"),
        ({"slots": [SLOTS[0], {**SLOTS[1], "name": "a"}]}, 'slots["a"].name', "station.slot_case"),
        ({"slots": [{**SLOTS[0], "lever_m": [0.1, -150.0, 0.0]}]}, 'slots["A"].lever_m[2]', "station.lever_too_long"),
        ({"slots": [SLOTS[0], {"port": PORTS[1]}]}, "slots[2].name", "entry.missing"),
        ({"slots": [{"name": f"N{n}", "port": f"/dev/tty{n}"} for n in range(17)]}, "slots", "station.too_many_slots"),
        ({"table": {"profile": "hand_rails"}, "slots": [{"name": "A"}]}, "table.profile", "station.slots_need_table"),
        ({"table": {"profile": "hand_rails"}}, "table.profile", "station.slots_need_table"),
        ({"table": {"profile": "gimbal", "port": "/dev/ttyUSB0"}}, "table.profile", "station.slots_need_table"),
        ({"table": {"profile": "indexing_unit", "port": PORTS[0]}}, "table.profile", "station.slots_need_table"),
    ],
)
def test_invalid_slots_are_refused(changes: dict[str, Any], entry: str, code: str) -> None:
    validate(StationConfig, HARDWARE, "station")
    with pytest.raises(ConfigurationError) as caught:
        validate(StationConfig, {**HARDWARE, **changes}, "station")
    assert error_code(caught.value) == f"{entry} {code}"


@pytest.mark.parametrize("units", [0, 17, 2.0, True, "2"])
def test_bench_accepts_one_to_sixteen_units(units: Any) -> None:
    with pytest.raises(ConfigurationError) as caught:
        validate(StationConfig, {**STATION, "bench": {"units": units}}, "station")
    assert error_code(caught.value) == "bench.units station.units_out_of_range"


def test_number_of_simulated_units_must_equal_the_number_of_slots() -> None:
    data = {**STATION, "bench": {"units": 3}, "slots": PLACES}
    assert validate(StationConfig, data, "station").slot_names == ("left", "right", "top")
    with pytest.raises(ConfigurationError) as caught:
        validate(StationConfig, {**data, "bench": {"units": 2}}, "station")
    assert error_code(caught.value) == "bench.units station.units_unlike_slots"
    with pytest.raises(ConfigurationError) as caught:
        validate(StationConfig, {**data, "slots": SLOTS, "bench": {}}, "station")
    assert error_code(caught.value) == 'slots["A"].port station.port_on_bench'


def test_lever_arm_of_a_slot_requires_a_table_with_units_off_centre(tmp_path: Path, site_folder: SiteFolder) -> None:
    text = library.find("tables", "bench").read_text(encoding="utf-8")
    fixed = re.sub(r'outer_lever = "\w+"', 'outer_lever = "fixed"', text)
    assert fixed != text
    folder = library.site_folder() / "tables"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "turns_about_the_unit.toml").write_text(fixed, encoding="utf-8")
    write(site_folder, table={"profile": "turns_about_the_unit"})
    with pytest.raises(ConfigurationError) as caught:
        load_station(site_folder.station)
    assert error_code(caught.value) == 'slots["right"].lever_m station.lever_fixed'


def test_editor_validates_the_profiles_and_products_of_slots() -> None:
    data = {**HARDWARE, "slots": [{**SLOTS[0], "imu": "none_such"}, {**SLOTS[1], "product": "none_such"}]}
    assert [problem.key_path for problem in check_data("stations", data)] == [
        ("slots", 0, "imu"),
        ("slots", 1, "product"),
    ]
    names = [problem.name for problem in check("stations", tomli_w.dumps(data))]
    assert names == ['slots["A"].imu', 'slots["B"].product']
    assert not check_data("stations", {**STATION, "bench": {"units": 3}})


def test_a_slot_on_the_port_of_the_table_is_reported() -> None:
    wrong = {**HARDWARE, "table": {"profile": "mn_ascii", "port": PORTS[1]}}
    (problem,) = station_conflicts(tomli_w.dumps(wrong))
    assert (problem.key_path, problem.name) == (("slots", 1, "port"), 'slots["B"].port')


def test_batch_has_one_request_per_occupied_slot(site_folder: SiteFolder) -> None:
    write(site_folder)
    requests = unit_requests(batch(site_folder, "SN-000001", "-", "SN-000003"))
    assert [(r.serial, r.slot, r.serials) for r in requests] == [("SN-000001", "left", ()), ("SN-000003", "top", ())]
    assert requests[0].batch == requests[1].batch
    assert re.fullmatch(r"B\d{8}T\d{6}-[0-9A-F]{4}", str(requests[0].batch))
    (only,) = unit_requests(replace(batch(site_folder, "", "SN-000002"), batch="B1"))
    assert (only.serial, only.slot, only.batch) == ("SN-000002", "right", "B1")


def test_run_with_a_single_unit_needs_no_batch(site_folder: SiteFolder) -> None:
    request = site_folder.request()
    assert unit_requests(request) == (request,)
    (setup,) = prepare_batch(request)
    assert setup == prepare_run(request)
    assert setup.slot is None


def test_batch_ids_differ() -> None:
    assert len({new_batch_id() for _ in range(20)}) > 1


@pytest.mark.parametrize(
    ("serials", "code"),
    [
        (("SN-000001",) * 2, "batch.serial_twice"),
        (tuple(f"SN-00000{n}" for n in range(4)), "batch.more_than_slots"),
        (("", "-"), "batch.no_unit"),
        (("SN-000001", "1"), "product.serial_mismatch"),
    ],
)
def test_invalid_serial_numbers_of_a_batch_are_refused(
    site_folder: SiteFolder, serials: tuple[str, ...], code: str
) -> None:
    write(site_folder)
    with raises_code(ConfigurationError, code):
        prepare_batch(batch(site_folder, *serials))


def test_station_for_one_unit_accepts_no_batch(site_folder: SiteFolder) -> None:
    with raises_code(ConfigurationError, "batch.one_unit"):
        prepare_batch(batch(site_folder, "SN-000001"))
    with pytest.raises(ConfigurationError) as caught:
        prepare_run(replace(site_folder.request(), slot="left"))
    assert error_code(caught.value) == "slots station.unknown_slot"


def test_product_with_a_different_schedule_cannot_share_the_table(site_folder: SiteFolder) -> None:
    folder = library.site_folder() / "products"
    folder.mkdir(parents=True, exist_ok=True)
    same = {**PRODUCT, "name": "same plan", "imu": "bench_tactical", "bench_grade": "tactical"}
    (folder / "same.toml").write_text(tomli_w.dumps(same), encoding="utf-8")
    schedule = {**PRODUCT["schedule"], "rate": {**PRODUCT["schedule"]["rate"], "turns": 2}}
    (folder / "other.toml").write_text(tomli_w.dumps({**PRODUCT, "schedule": schedule}), encoding="utf-8")
    write(site_folder, slots=[PLACES[0], {"name": "B", "product": "same"}, {"name": "C", "product": "other"}])
    first, second = prepare_batch(batch(site_folder, "SN-000001", "SN-000002"))
    assert (first.product.name, second.product.name) == ("short", "same plan")
    assert [s.sources["imu"].path.stem for s in (first, second)] == ["bench_nav", "bench_tactical"]
    config = bench_config(first, second)
    assert config is not None
    assert [config["grade"], config["secondaries"][0]["grade"]] == ["nav", "tactical"]
    with raises_code(ConfigurationError, "batch.other_plan"):
        prepare_batch(batch(site_folder, "SN-000001", "", "SN-000003"))


def test_unit_has_the_configuration_of_its_slot(site_folder: SiteFolder) -> None:
    write(site_folder)
    first, second = prepare_batch(replace(batch(site_folder, "SN-000001", "SN-000002"), batch="B1"))
    assert second.slot is not None
    assert (second.slot.name, second.number, first.number) == ("right", 2, 1)
    meta, plain = second.log_meta(), first.log_meta()
    assert (meta.run and (meta.run.batch, meta.run.slot)) == ("B1", "right")
    assert (meta.table.orientation, plain.table.orientation) == ("-y+z", "+x+z")
    levers = [meta.prior[f"outer_lever_{axis}"].value for axis in "xyz"]
    assert levers == [0.1, -0.2, 0.0]
    assert {p.value for p in plain.prior.values()} == {0.0}
    assert unit_task(second).geometry.orientation == orientation_matrix("-y+z")
    assert table_task(second).geometry == table_task(first).geometry == unit_task(first).geometry


def test_a_single_unit_uses_the_first_slot(site_folder: SiteFolder) -> None:
    write(site_folder)
    setup = prepare_run(site_folder.request())
    assert setup.slot is not None
    assert setup.slot.name == "left"
    run = setup.log_meta().run
    assert run is not None
    assert (run.batch, run.slot) == (None, None)


def test_unit_has_the_link_settings_of_its_slot() -> None:
    link = {"serial": {"baud": 921600}, "timeout_s": 2.0, "imu": "bench_mems"}
    station = validate(StationConfig, {**HARDWARE, "slots": [SLOTS[0], {**SLOTS[1], **link}]}, "station")
    placed = at_slot(station, "B")
    assert (placed.imu.port, placed.imu.timeout_s) == (PORTS[1], 2.0)
    assert placed.imu.serial is not None
    assert placed.imu.serial.baud == 921600
    assert at_slot(station, None).imu.port == PORTS[0]


def test_bench_of_a_batch_simulates_each_unit(site_folder: SiteFolder) -> None:
    bench = {**BENCH, "serial": "SN-000001", "orders": [{"order": "reset_imu", "at": 9.0, "unit": 2}]}
    write(site_folder, bench={**bench, "secondaries": [{"ready_time_s": 3.0}, {"grade": "mems"}]})
    request = batch(site_folder, "SN-000001", "", "SN-000003")
    setups = prepare_batch(replace(request, serials=("SN-000001", "SN-000002", "SN-000003")))
    config = bench_config(*setups)
    alone = bench_config(prepare_run(site_folder.request(serial="SN-000001")))
    assert config is not None
    second, third = config.pop("secondaries")
    assert config == {**alone, "unit": 1} if alone else False
    assert [u["serial"] for u in (config, second, third)] == ["SN-000001", "SN-000002", "SN-000003"]
    assert len({u["seed"] for u in (config, second, third)}) == 3
    assert len({u["flash_file"] for u in (config, second, third)}) == 3
    assert [(u["unit"], u["orders"]) for u in (second, third)] == [(2, []), (3, [])]
    assert (second["ready_time_s"], third["grade"], second["grade"]) == (3.0, "mems", "nav")
    assert (second["orientation"], second["lever_m"]) == ("-y+z", [0.1, -0.2, 0.0])
    assert abs(second["clock_drift_ppm"]) < 20.0
    assert second["clock_drift_ppm"] != third["clock_drift_ppm"]
    whole = BenchConfig.model_validate({**config, "secondaries": [second, third]})
    assert whole.secondaries[0].truth().parameters[-3:] != pytest.approx([0.1, -0.2, 0.0])
    assert BenchConfig.model_validate(bench_config(setups[1])).truth().parameters == pytest.approx(
        whole.secondaries[0].truth().parameters
    )


def test_shipped_batch_station_has_sixteen_units(tmp_path: Path) -> None:
    path = library.find("stations", "virtual_batch")
    _, station = load_station(path)
    assert station.slot_names == tuple(str(number) for number in range(1, 17))
    serials = tuple(f"SN-{number:06d}" for number in range(1, 17))
    setups = prepare_batch(RunRequest(serials[0], path, out=tmp_path, serials=serials))
    assert [setup.request.slot for setup in setups] == list(station.slot_names)
    config = bench_config(*setups)
    assert config is not None
    assert len(BenchConfig.model_validate(config).secondaries) == 15
    plain = prepare_run(RunRequest(serials[0], library.find("stations", "virtual_bench"), out=tmp_path))
    assert BenchConfig.model_validate(bench_config(plain)) == BenchConfig.model_validate({**config, "secondaries": []})


def test_fault_plan_applies_to_the_unit_it_names(site_folder: SiteFolder, tmp_path: Path) -> None:
    write(site_folder)
    faults = [{"kind": "wrong_unit", "unit": 2}, {"kind": "silence_imu", "unit": 3, "time_s": 5.0}]
    plan = tmp_path / "plan.toml"
    plan.write_text(tomli_w.dumps({"fault": faults}), encoding="utf-8")
    request = replace(batch(site_folder, "SN-000001", "SN-000002", "SN-000003"), faults=plan)
    config = bench_config(*prepare_batch(request, with_faults))
    assert config is not None
    units = (config, *config["secondaries"])
    assert [unit["serial"] for unit in units] == ["SN-000001", "SN-000002-OTHER", "SN-000003"]
    assert config["orders"] == [{"order": "silence_imu", "at": 5.0, "unit": 3}]


@pytest.mark.parametrize("kind", ["wrong_unit", "silence_imu"])
@pytest.mark.parametrize("unit", [2, 7])
def test_fault_for_a_missing_unit_is_refused(site_folder: SiteFolder, tmp_path: Path, kind: str, unit: int) -> None:
    write(site_folder)
    plan = tmp_path / "plan.toml"
    when = {} if kind == "wrong_unit" else {"stage": "rate"}
    of_table = {"kind": "interlock", "stage": "rate", "unit": unit}
    plan.write_text(tomli_w.dumps({"fault": [of_table, {"kind": kind, "unit": unit, **when}]}), encoding="utf-8")
    request = replace(batch(site_folder, "SN-000001", "-", "SN-000003"), faults=plan)
    with pytest.raises(ConfigurationError) as caught:
        prepare_batch(request, with_faults)
    assert f"{plan}: fault[2].unit: No unit is in slot {unit}, counted from 1. Choose from: 1, 3." in str(caught.value)
