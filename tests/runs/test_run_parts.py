"""Parts of a run in isolation: profile search, register composition, chained stages, clocks."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from calstation.bench import BenchClock, BenchHost
from calstation.config import (
    RunRequest,
    check,
    compatible_products,
    library,
    with_product,
)
from calstation.connection import RealClock
from calstation.errors import ConfigurationError, DeviceFaultError, InputError, InsufficientDataError
from calstation.physics import NAMES, compose, group_matrix, group_vector
from calstation.results import solve
from calstation.simulation import bench_config
from tests.helpers import raises_code
from tests.prepared import prepare_run
from tests.site_folder import SiteFolder


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty site folder."""
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    return tmp_path


def test_shipped_profiles_are_found(home: Path) -> None:
    assert library.find("tables", "bench").parent == library.shipped_folder() / "tables"
    assert "nav_a" in library.names("products")


def test_site_profile_overrides_the_shipped_profile(home: Path) -> None:
    (home / "tables").mkdir()
    own = home / "tables" / "bench.toml"
    own.write_text("", encoding="utf-8")
    assert library.find("tables", "bench") == own


def test_error_for_an_unknown_profile_lists_the_existing_profiles(home: Path) -> None:
    shipped = "acutronic_acl, aerosmith_atl, bench, cia402_drives, gimbal, hand_rails, indexing_unit, mn_ascii"
    with pytest.raises(ConfigurationError, match=f"Choose from: {shipped}"):
        library.find("tables", "none")


@pytest.mark.parametrize("product", ["nav_a", "tactical_b", "mems_c"])
def test_every_shipped_product_can_be_run(site_folder: SiteFolder, product: str) -> None:
    request = site_folder.request(serial="SN-000001")
    request = type(request)(request.serial, product=library.find("products", product))
    setup = prepare_run(request)
    assert setup.stages == ("rate", "six_position", "excitation", "azimuth_flip")
    assert bench_config(setup)["serial"] == "SN-000001"


def test_serial_number_determines_the_simulated_unit_for_a_seed() -> None:
    def drawn(serial: str, seed: int | None = None) -> int:
        setup = prepare_run(RunRequest(serial, seed=seed))
        run = setup.log_meta().run
        assert run is not None
        assert run.seed == (seed or 1)
        return int(bench_config(setup)["seed"])

    units = [drawn("SN-000001"), drawn("SN-000002"), drawn("SN-000001", 7)]
    assert len(set(units)) == 3
    assert units == [drawn("SN-000001"), drawn("SN-000002"), drawn("SN-000001", 7)]


def test_products_for_manual_rigs_and_tables_are_distinguished(home: Path) -> None:
    rails, positions = library.find("stations", "virtual_hand"), library.find("products", "mems_positions")
    assert [name for name, _ in compatible_products(rails, positions)] == ["mems_hand"]
    (home / "products").mkdir()
    (home / "products" / "broken.toml").write_text("name = 1", encoding="utf-8")
    fit_a_table = ["mems_c", "mems_c_fast", "mems_positions", "nav_a", "nav_a_fast", "tactical_b", "tactical_b_fast"]
    assert [name for name, _ in compatible_products(None, positions)] == fit_a_table
    gimbal = library.find("stations", "virtual_gimbal")
    assert [name for name, _ in compatible_products(gimbal, positions)] == ["mems_gimbal"]


@pytest.mark.parametrize(
    ("station", "product"),
    [
        ("virtual_bench", None),
        ("virtual_batch", None),
        ("virtual_hand", "mems_hand"),
        ("virtual_gimbal", "mems_gimbal"),
    ],
)
def test_run_without_a_product_takes_one_that_the_station_can_calibrate(station: str, product: str | None) -> None:
    request = with_product(RunRequest("", library.find("stations", station)))
    assert request.product == (None if product is None else library.find("products", product))


def test_station_names_the_product_with_which_it_starts(tmp_path: Path) -> None:
    text = library.find("stations", "virtual_bench").read_text(encoding="utf-8")
    (tmp_path / "stations").mkdir()
    station = tmp_path / "stations" / "line.toml"
    station.write_text(f'product = "tactical_b"\n{text}', encoding="utf-8")
    assert with_product(RunRequest("", station)).product == library.find("products", "tactical_b")
    given = library.find("products", "mems_c")
    assert with_product(RunRequest("", station, given)).product == given
    assert with_product(RunRequest("", station, resume=Path("log.h5"))).product is None
    station.write_text(f'product = "unknown"\n{text}', encoding="utf-8")
    assert [problem.name for problem in check("stations", station.read_text(encoding="utf-8"))] == ["product"]
    with raises_code(ConfigurationError, "configuration.no_profile"):
        with_product(RunRequest("", station))


def test_composed_registers_equal_two_successive_corrections() -> None:
    random = np.random.default_rng(1)
    old, found = (dict(zip(NAMES, random.normal(0.0, 1e-2, 30), strict=True)) for _ in range(2))
    whole = np.array(list(compose(old, found).values()))
    omega = random.normal(0.0, 1.0, 3)

    def measured(values: np.ndarray, truth: np.ndarray) -> np.ndarray:
        matrix = np.eye(3) + group_matrix(values, "gyro_scale", "gyro_misalign")
        return np.asarray(matrix @ truth + group_vector(values, "gyro_bias"))

    in_turn = measured(np.array(list(old.values())), measured(np.array(list(found.values())), omega))
    assert np.allclose(measured(whole, omega), in_turn, rtol=0.0, atol=1e-15)


def test_composing_with_empty_registers_changes_nothing() -> None:
    found = dict(zip(NAMES, np.random.default_rng(2).normal(0.0, 1e-3, 30).tolist(), strict=True))
    assert compose({}, found) == pytest.approx(found, abs=1e-15)


@pytest.mark.long
def test_stages_are_solved_in_another_order_than_recorded(site_folder: SiteFolder) -> None:
    site_folder.write({"stages": ["six_position", "rate"]})
    ended = site_folder.run("six_position", "rate")
    from calstation.records import open_log

    log = open_log(Path(ended.log))
    chain = solve(log.blocks, log.meta, ("rate", "six_position"))
    assert [s.stage for s in chain.solutions] == ["rate", "six_position"]
    assert [s.stage for s in solve(log.blocks, log.meta).solutions] == ["six_position", "rate"]

    blocks = list(log.blocks())
    stages = [b.stage for b in blocks]
    first = stages.index("six_position")
    with pytest.raises(InputError, match="recorded twice"):
        solve(lambda: [*blocks, blocks[first]], log.meta)
    with pytest.raises(InsufficientDataError, match="or any other stage"):
        solve(lambda: [b for b in blocks if not b.stage], log.meta, ("rate",))
    with pytest.raises(InsufficientDataError, match="No sample in the chosen range"):
        solve(lambda: [b for b in blocks if not b.stage], log.meta)


def test_bench_that_cannot_start_reports_the_reason() -> None:
    with pytest.raises(DeviceFaultError, match="grade"):
        BenchHost.start({"grade": "toy"})


def test_bench_clock_advances_only_during_sleep() -> None:
    with closing(BenchHost.start({"speed": 0.0})) as host:
        name, _, port = host.endpoints["clock"].rpartition(":")
        clock = BenchClock((name, int(port)), 0.0)
        begin = clock.now()
        clock.idle(0.01)
        assert clock.now() == begin
        clock.sleep(2.5)
        assert clock.now() == pytest.approx(begin + 2.5)
        clock.close()
    assert host.process.returncode == 0


def test_terminated_bench_is_a_device_fault() -> None:
    with closing(BenchHost.start({"speed": 0.0})) as host:
        name, _, port = host.endpoints["clock"].rpartition(":")
        clock = BenchClock((name, int(port)), 0.0)
        host.process.kill()
        host.process.wait()
        with pytest.raises(DeviceFaultError, match="virtual bench"):
            clock.sleep(1.0)
        clock.close()


def test_real_clock_follows_real_time() -> None:
    clock = RealClock()
    begin = clock.now()
    clock.sleep(0.01)
    clock.idle(0.01)
    assert clock.now() - begin >= 0.02
