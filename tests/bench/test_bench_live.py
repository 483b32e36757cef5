"""The live bench produces the same samples as the simulator and injects faults at the configured times."""

import numpy as np
import pytest

from calstation.bench import BenchConfig, FaultCommand
from calstation.bench.imu.unit import BOOT_TIME, STREAM, crc16
from calstation.bench.live import LiveBench
from calstation.bench.table import Fault
from calstation.bench.truth import Simulator
from calstation.physics import Dwell, Move


def bench(**changes):
    values = {"start_deg": (0.0, 0.0), "clock_drift_ppm": 0.0, **changes}
    return LiveBench(BenchConfig(**values), lambda: 0.0)


def ready(**changes):
    live = bench(**changes)
    for word in (0x06, 0x07, 0x0F):
        live.machine.control(word, live.device_time, 0.0)
    live.machine.home(live.device_time)
    return live


def decode(data):
    frames = np.frombuffer(data, dtype=STREAM)
    assert all(crc16(frame.tobytes()[2:-2]) == frame["crc"] for frame in frames)
    return frames


def test_live_samples_equal_the_simulator_samples():
    live = ready(seed=9)
    data = b"".join(live.advance(t) for t in np.arange(1, 21) * 0.05)
    live.machine.move(live.device_time, (0.5, -1.0), (0.7, 0.7), (1.0, 1.0))
    data += b"".join(live.advance(1.0 + t) for t in np.arange(1, 121) * 0.05)
    simulator = Simulator(live.truth, np.random.SeedSequence([9, 1]))
    expected = simulator.run([Dwell(1.0), Move(0.5, -1.0, 0.7, 1.0), Dwell(10.0)], "").counts
    counts = decode(data)["channels"]
    silent = round(BOOT_TIME * 200)
    assert len(counts) == 1400 - silent
    assert np.array_equal(counts, expected[silent:1400])


def test_device_time_runs_fast_by_the_clock_drift():
    live = bench(clock_drift_ppm=1e4)
    live.advance(10.0)
    assert live.device_time == pytest.approx(10.1)
    assert live.sample_count == 2020


def test_polled_angle_is_delayed_by_latency_and_jitter():
    live = ready(latency_s=0.01, jitter_s=0.004, encoder_noise_deg=0.0)
    live.advance(5.0)
    live.machine.move(5.0, (10.0, 0.0), (1.0, 1.0), (2.0, 2.0))
    live.advance(10.0)
    truth = live.machine.drive.readings(np.array([10.0]))[0, 0]
    ages = []
    for _ in range(200):
        live.registers.refresh()
        words = live.registers.words[30:32]
        ages.append(truth - np.deg2rad(1e-5) * (words[0] * 65536 + words[1]))
    assert min(ages) == pytest.approx(0.006, abs=4e-4)
    assert max(ages) == pytest.approx(0.014, abs=4e-4)


def test_faults_are_injected_at_their_times():
    live = ready(orders=[FaultCommand(order="stall", at=3.0), FaultCommand(order="reset_imu", at=2.0)])
    frames = decode(live.advance(2.9))
    assert live.machine.fault is Fault.NONE
    assert np.flatnonzero(np.diff(frames["counter"].astype(int)) < 0).size == 1
    live.advance(3.1)
    assert live.machine.fault is Fault.STALL


def test_frames_are_dropped_corrupted_and_silenced_on_request():
    live = bench()
    start = len(decode(live.advance(1.0)))
    live.execute(FaultCommand(order="drop_frames", value=3))
    assert list(decode(live.advance(1.1))["counter"][:2]) == [start + 3, start + 4]
    live.execute(FaultCommand(order="corrupt_frames", value=2))
    raw = np.frombuffer(live.advance(1.2), dtype=STREAM)
    wrong = [crc16(frame.tobytes()[2:-2]) != frame["crc"] for frame in raw]
    assert wrong == [True, True] + [False] * 18
    live.execute(FaultCommand(order="silence_imu", value=0.5))
    assert live.advance(1.6) == b""
    assert len(decode(live.advance(1.9))) == 40, "silent up to 1.7 s"


@pytest.mark.parametrize("stride", [0.013, 0.05, 0.1, 3.0])
def test_duration_of_a_fault_does_not_depend_on_the_time_steps(stride):
    orders = [
        FaultCommand(order="saturate_imu", at=0.5, value=0.1),
        FaultCommand(order="invalid_imu", at=1.0, value=0.1),
        FaultCommand(order="silence_imu", at=1.5, value=0.3),
    ]
    live = ready(orders=orders)
    times = np.append(np.arange(stride, 3.0, stride), 3.0)
    frames = decode(b"".join(live.advance(float(t)) for t in times))
    first = frames["channels"][:, 0]
    assert [int((first == end).sum()) for end in (2**31 - 1, -(2**31))] == [20, 20]
    assert int((frames["status"] & 2 > 0).sum()) == 20
    assert len(frames) == 600 - 20 - 60
    assert np.diff(frames["counter"].astype(int)).max() == 61


def test_out_of_limits_setting_gives_a_unit_outside_its_limits():
    parameters = bench(out_of_limits=True).truth.parameters
    assert abs(parameters[0]) > 15.0 * np.deg2rad(1.0) / 3600.0
