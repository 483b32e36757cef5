"""Several units on one simulated table share its motion; each has its own errors, noise, mounting and clock."""

import itertools

import numpy as np
import pytest

from calstation.bench import BenchConfig, FaultCommand
from calstation.bench.imu.unit import STREAM
from calstation.bench.live import LiveBench
from calstation.bench.table import Fault
from calstation.bench.truth import unit_axes
from calstation.bench.truth.table import EARTH_RATE
from calstation.errors import ConfigurationError
from calstation.physics import NAMES
from calstation.schema import validate
from tests.helpers import raises_code

ORIENTATIONS = ["".join(part) for part in itertools.product("+-", "xyz", "+-", "xyz") if part[1] != part[3]]
#: A unit without errors or noise on a table without errors, so that its output is its motion.
IDEAL = {
    "start_deg": (0.0, 0.0),
    "clock_drift_ppm": 0.0,
    "instability": False,
    "parameters": dict.fromkeys(NAMES, 0.0),
    "effects": {"gyro_noise": 0.0, "accel_noise": 0.0},
    "velocity_sigma": 0.0,
    "mount_deg": (0.0, 0.0),
    "base_tilt_deg": 0.0,
    "azimuth_error_deg": 0.0,
    "non_orthogonality_arcsec": 0.0,
    "wobble_arcsec": 0.0,
    "gravity_mps2": 9.8,
}


def batch(*settings, **common):
    """Create units on one homed table."""
    configs = [
        BenchConfig(**{"start_deg": (0.0, 0.0), "unit": n, **common, **own}) for n, own in enumerate(settings, 1)
    ]
    first = LiveBench(configs[0].model_copy(update={"secondaries": tuple(configs[1:])}), lambda: 0.0)
    units = [first, *(LiveBench(config, lambda: 0.0, first) for config in configs[1:])]
    for word in (0x06, 0x07, 0x0F):
        first.machine.control(word, first.device_time, 0.0)
    first.machine.home(first.device_time)
    advance(units, 1.0)
    return units


def advance(units, seconds):
    """Return the frames that each unit sends in the next `seconds`."""
    until = units[0].now + seconds
    own = b""
    while units[0].now < until - 1e-9:
        own += units[0].advance(min(units[0].now + 0.5, until))
    sent = [own, *(b"".join(unit.outbox) for unit in units[1:])]
    for unit in units:
        unit.outbox.clear()
    return [np.frombuffer(data, dtype=STREAM) for data in sent]


def increments(unit, frames):
    """Return the increments of the six channels, rad and m/s."""
    imu = unit.truth.imu
    return frames["channels"] * np.repeat([imu.gyro_lsb, imu.accel_lsb], 3)


def forces(units, seconds=2.0):
    """Return each unit's mean specific force over the next `seconds`, m/s²."""
    return [200.0 * increments(u, f)[:, 3:].mean(axis=0) for u, f in zip(units, advance(units, seconds), strict=True)]


def move(units, outer, inner):
    """Move the table and return the frames of each unit during the move."""
    units[0].machine.move(units[0].device_time, (outer, inner), (1.0, 1.0), (2.0, 2.0))
    return advance(units, 6.0)


def test_orientation_gives_the_unit_axes_along_x_and_z_of_the_platform():
    assert len({unit_axes(name).tobytes() for name in ORIENTATIONS}) == 24
    for name in ORIENTATIONS:
        axes = unit_axes(name)
        assert np.array_equal(axes @ axes.T, np.eye(3))
        assert np.linalg.det(axes) == pytest.approx(1.0)
    assert np.array_equal(unit_axes("-y+z"), [[0, -1, 0], [1, 0, 0], [0, 0, 1]])


@pytest.mark.parametrize("name", ["+x-x", "xz", "+x+w", "+x+z+y", ""])
def test_invalid_orientation_is_rejected(name):
    with pytest.raises(ValueError, match="orientation"):
        BenchConfig(orientation=name)


def test_units_at_rest_measure_gravity_along_the_upward_axis():
    names = ("+x+z", "-y+z", "+z-x")
    units = batch(*({"orientation": name} for name in names), **IDEAL)
    for name, force in zip(names, forces(units), strict=True):
        assert force == pytest.approx(9.8 * unit_axes(name)[2], abs=1e-4)
    assert forces(units)[2] == pytest.approx([-9.8, 0.0, 0.0], abs=1e-4)
    move(units, np.pi / 2, 0.0)  # a rotation about x, after which y of the platform is up
    for name, force in zip(names, forces(units), strict=True):
        assert force == pytest.approx(9.8 * unit_axes(name)[1], abs=1e-4)
    move(units, np.pi / 2, np.pi / 2)  # a rotation about z of the platform, after which x is up
    for name, force in zip(names, forces(units), strict=True):
        assert force == pytest.approx(9.8 * unit_axes(name)[0], abs=1e-4)


def test_table_rotation_is_measured_about_the_vertical_axis_of_each_unit():
    units = batch({}, {"orientation": "+z+y"}, {"orientation": "-x-z"}, **IDEAL)
    for unit, frames in zip(units, move(units, 0.0, 2.0), strict=True):
        turned = increments(unit, frames)[:, :3].sum(axis=0)
        up = unit_axes(unit.truth.table.orientation)[2]
        assert turned @ up == pytest.approx(2.0, abs=6.0 * EARTH_RATE)


def test_nominal_lever_arm_is_added_to_the_random_lever_arm():
    drawn, placed = BenchConfig(seed=4).truth(), BenchConfig(seed=4, lever_m=(0.1, 0.2, -0.3)).truth()
    added = dict(zip(NAMES, placed.parameters - drawn.parameters, strict=True))
    levers = {"outer_lever_x": 0.1, "outer_lever_y": 0.2, "outer_lever_z": -0.3}
    assert added == pytest.approx({name: levers.get(name, 0.0) for name in NAMES})


def test_output_of_the_first_unit_does_not_depend_on_other_units():
    alone = batch({"seed": 9})
    together = batch({"seed": 9}, {"seed": 4, "orientation": "-y+z", "clock_drift_ppm": -7.0}, {"seed": 5})
    for units in (alone, together):
        units[0].machine.move(units[0].device_time, (0.5, -1.0), (0.7, 0.7), (1.0, 1.0))
    for seconds in (0.05, 0.4, 3.0):
        assert np.array_equal(advance(alone, seconds)[0], advance(together, seconds)[0])


def test_unit_keeps_its_errors_in_any_slot_and_shares_the_table_errors():
    settings = {"seed": 4, "orientation": "-y+z"}
    units = batch({"seed": 9}, settings)
    own, first = BenchConfig(**settings).truth(), units[0].truth
    assert np.array_equal(units[1].truth.parameters, own.parameters)
    assert units[1].truth.table.mount == own.table.mount != first.table.mount
    assert units[1].truth.table.azimuth == first.table.azimuth != own.table.azimuth
    assert units[1].truth.encoder == first.encoder


def test_noise_of_two_units_is_independent():
    units = batch(*({"seed": seed} for seed in (1, 2)))
    first, second = (increments(u, f) for u, f in zip(units, advance(units, 50.0), strict=True))
    count = len(first)
    for channel in range(6):
        related = np.corrcoef(first[:, channel], second[:, channel])[0, 1]
        assert abs(related) < 5.0 / np.sqrt(count)


@pytest.mark.parametrize(("drift", "power_on"), [(2e4, 0.0), (-2e4, 0.317)])
def test_unit_with_a_different_clock_samples_the_same_motion_in_its_own_time(drift, power_on):
    units = batch({}, {"clock_drift_ppm": drift, "power_on_s": power_on}, **IDEAL)
    assert units[1].device_time == pytest.approx((units[0].now - power_on) * (1.0 + 1e-6 * drift))
    begin, rate = units[1].sample_count, 200.0 * (1.0 + 1e-6 * drift)
    first, second = (increments(u, f) for u, f in zip(units, move(units, 0.0, 2.0), strict=True))
    assert units[1].sample_count - begin == pytest.approx(6.0 * rate, abs=1.0)
    assert second[:, 2].sum() == pytest.approx(first[:, 2].sum(), abs=1e-5)
    # the angle reached at equal times of the control service, by interpolation
    times = np.arange(0.2, 3.0, 0.1)
    ends = (np.arange(units[1].sample_count - len(second), units[1].sample_count) + 1) / rate + power_on
    starts = (np.arange(units[0].sample_count - len(first), units[0].sample_count) + 1) / 200.0
    angles = [
        np.interp(times + units[0].now - 6.0, t, np.cumsum(x[:, 2])) for t, x in ((starts, first), (ends, second))
    ]
    assert angles[1] == pytest.approx(angles[0], abs=1e-4)
    assert 200.0 * second[-200:, 5].mean() == pytest.approx(9.8, abs=1e-4), "per second of its own clock"


def test_table_fault_within_a_time_step_affects_all_units_equally():
    order = FaultCommand(order="stall", at=2.0)
    units = batch({"orders": [order]}, {}, **IDEAL)
    first, second = (increments(u, f) for u, f in zip(units, move(units, 0.0, 2.0), strict=True))
    assert units[0].machine.fault is Fault.STALL
    assert 0.2 < first[:, 2].sum() < 1.9
    assert second == pytest.approx(first, abs=1e-12)


def test_fault_command_for_an_unknown_unit_is_rejected():
    with raises_code(ConfigurationError, "entry.in_file"):
        validate(BenchConfig, {"orders": [{"order": "reset_imu", "unit": 3}], "secondaries": [{"unit": 2}]}, "bench")


def test_timed_fault_command_silences_only_its_unit(start_bench, imu_client):
    further = [{"unit": unit, "serial": f"SN-{unit}", "seed": unit} for unit in (2, 4)]
    orders = [{"order": "silence_imu", "value": 0.5, "at": 1.0, "unit": 4}]
    with start_bench(secondaries=further, orders=orders, clock_drift_ppm=0.0) as bench:
        clients = [imu_client(bench.endpoints[name]) for name in ("imu", "imu2", "imu3")]
        names = [client.command(1)[1] for client in clients]
        assert names == [b"bench-imu;SN-000001;1.0.0", b"bench-imu;SN-2;1.0.0", b"bench-imu;SN-4;1.0.0"]
        before = bench.advance(0.5)["bytes"]
        after = bench.advance(1.5)["bytes"]
        sent = [(b - a) / STREAM.itemsize for a, b in zip(before, after, strict=True)]
        assert sent[0] == 300
        assert sent[2] == pytest.approx(200, abs=1), "by its own clock"
        bench.ask(order="silence_imu", value=1.0, unit=2)
        now = bench.advance(1.0)["bytes"]
        sent = [round((b - a) / STREAM.itemsize) for a, b in zip(after, now, strict=True)]
        assert sent[1] <= 1
        assert sent[0] == 200
        assert "error" in bench.ask(order="silence_imu", value=1.0, unit=3)
        assert bench.ask(order="interlock", value=0, unit=3)["bytes"] == now, "the table has no unit"


@pytest.mark.long
def test_each_serial_line_counts_its_bytes_until_its_client_disconnects(start_bench, imu_client):
    further = [{"unit": unit, "serial": f"SN-{unit}", "seed": unit} for unit in range(2, 17)]
    with start_bench(secondaries=further) as bench:
        clients = [imu_client(bench.endpoints[f"imu{n}" if n > 1 else "imu"]) for n in range(1, 17)]
        for client in clients:
            assert client.command(1)[0] == 1
        for _ in range(5):
            for client, count in zip(clients, bench.advance(2.0)["bytes"], strict=True):
                client.wait_for(count)
                assert len(client.data) == count
        clients[7].close()
        for _ in range(200):
            sent = bench.advance(0.05)["bytes"]
            if sent[7] == 0:
                break
        assert sent[7] == 0
        assert min(sent[:7] + sent[8:]) > 0
