"""Time to process a live 2 kHz stream, to simulate and read a log, and to solve a one-hour log, also by its command."""

import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from time import perf_counter, process_time

import numba as nb
import numpy as np
import pytest
from simulated_stages import block_of, context_of, cut, geometry_of, prior_of, simulate, solver_of

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.estimation.common import SampleBlock, stage_data
from calstation.physics import NAMES, compensation, increments, interval_work, propagate, rotation_rate
from calstation.records import LogMeta, RawLogWriter, context_from_meta, open_log
from calstation.results import one_blas_thread, resolve
from procedures import method

PRACTICE = Path(__file__).parents[3] / "shared" / "data" / "practice"
#: Time between blocks and between looks at the sigmas, s of the stream.
TICK, LOOK = 0.05, 1.0
HOUR = {
    "rate": {"turns": 2},
    "six_position": {"dwell_s": 30.0},
    "excitation": {"rounds": 3, "dwell_s": 20.0},
    "azimuth_flip": {"rounds": 4, "dwell_s": 60.0},
}


def test_live_2_khz_stream_is_processed_faster_than_real_time(benchmark, figures):
    truth = BenchConfig(grade="nav", seed=51, sample_rate_hz=2000.0).truth()
    block = block_of(simulate(Simulator(truth, 51), truth, "excitation", dwell_s=4.0, place_dwell_s=2.0))
    seconds = len(block) / 2000.0
    parts = cut(block, list(range(int(TICK * 2000), len(block), int(TICK * 2000))))

    def follow():
        solver = solver_of(truth, prior_of(truth), "excitation")
        longest = 0.0
        for number, part in enumerate(parts):
            begin = perf_counter()
            solver.feed(part)
            if number % round(LOOK / TICK) == 0:
                solver.sigma()
            longest = max(longest, perf_counter() - begin)
        return longest

    with one_blas_thread():
        follow()
        begin = process_time()
        longest = benchmark.pedantic(follow, rounds=1)
        share = (process_time() - begin) / seconds
    figures(stream_s=round(seconds), share_of_real_time=round(share, 4), longest_block_ms=round(longest * 1e3, 1))
    assert share < 0.5


def test_half_an_hour_is_simulated_faster_than_real_time(benchmark, figures):
    truth = BenchConfig(grade="nav", seed=1, sample_rate_hz=100.0).truth()
    simulate(Simulator(truth, 1), truth, "azimuth_flip", rounds=1)
    begin = process_time()
    found = benchmark.pedantic(lambda: simulate(Simulator(truth, 1), truth, "azimuth_flip", rounds=8), rounds=1)
    share = (process_time() - begin) / (len(block_of(found)) / 100.0)
    figures(share_of_real_time=round(share, 5))
    assert share < 0.005


@pytest.mark.skipif(not PRACTICE.is_dir(), reason="the practice logs are not beside the project")
def test_text_log_is_read_faster_than_real_time(benchmark, figures):
    log = open_log(PRACTICE / "nav_full.csv.gz")
    begin = process_time()
    count = benchmark.pedantic(lambda: sum(len(block) for block in log.blocks()), rounds=1)
    share = (process_time() - begin) / (count / 200.0)
    figures(share_of_real_time=round(share, 5))
    assert share < 0.01


@pytest.fixture(scope="module")
def hour(tmp_path_factory):
    """A one-hour raw log at 200 Hz with all four stages, and the true parameters of its unit."""
    truth = BenchConfig(grade="nav", seed=52).truth()
    context, simulator = context_of(truth), Simulator(truth, 52)
    prior = prior_of(truth).sigma
    meta = LogMeta.model_validate(
        {
            "site": {
                "latitude_deg": float(np.rad2deg(context.site.latitude)),
                "longitude_deg": 0.0,
                "height_m": context.site.height,
                "azimuth_deg": 0.0,
            },
            "imu": {
                "serial": "HOUR",
                "sample_rate_hz": context.imu.sample_rate,
                "output": context.imu.output,
                "gyro_lsb": context.imu.gyro_lsb,
                "accel_lsb": context.imu.accel_lsb,
                "gyro_arw": context.imu.gyro_arw,
                "accel_vrw": context.imu.accel_vrw,
                "gyro_bias_instability": context.imu.gyro_bias_instability,
                "accel_bias_instability": context.imu.accel_bias_instability,
            },
            "prior": {name: {"sigma": float(sigma)} for name, sigma in zip(NAMES, prior, strict=True)},
            "schedule": HOUR,
        }
    )
    path = tmp_path_factory.mktemp("hour") / "hour.h5"
    writer = RawLogWriter(path, meta)
    for stage, settings in HOUR.items():
        chosen = method(stage)
        schedule = chosen.schedule(**settings)
        samples = simulator.run(chosen.plan(geometry_of(truth), schedule), stage, settings.get("rounds"))
        block: SampleBlock = block_of(samples)
        for a, b in pairwise([*range(0, len(block), 200), len(block)]):
            writer.append(block.part(a, b))
    writer.close("passed")
    return path, truth


@nb.njit
def strapdown(c, earth, gravity, dt, gyro, accel, work):
    """Integrate attitude and velocity, and the transition of their errors every 0.1 s."""
    motion = increments(c, dt, gyro, accel)
    for k in range(0, len(gyro) - 20, 20):
        propagate(c, earth, gravity, dt, motion, k, k + 20, work)


def plain_pass(path):
    """Return the CPU time, s, of one plain pass over a log at the IMU's rate; the best of five."""
    log = open_log(path)
    context = context_from_meta(log.meta)
    data = stage_data(list(log.blocks()), context.imu)
    earth, constants = rotation_rate(context.site.latitude), compensation(np.zeros(len(NAMES)))
    took = []
    for _ in range(6):
        begin = process_time()
        strapdown(constants, earth, context.site.local_gravity, data.dt, data.gyro, data.accel, interval_work())
        took.append(process_time() - begin)
    return min(took[1:])


def test_one_hour_log_is_solved_in_seconds(hour, benchmark, figures):
    path, truth = hour
    resolve(path, stages=("azimuth_flip",))
    plain, took, alone = plain_pass(path), [], []

    def solved(times=took, **more):
        begin = process_time()
        result = resolve(path, **more).result
        times.append(process_time() - begin)
        return result

    result = benchmark.pedantic(solved, rounds=3)
    for _ in range(3):
        assert solved(alone, diagnostics=False).parameters == result.parameters
    hours = (result.log.last_seq - result.log.first_seq + 1) / 200.0 / 3600.0
    ratio = min(took) / plain
    figures(
        processor_s_per_hour=round(min(took) / hours, 2),
        plain_pass_s_per_hour=round(plain / hours, 3),
        ratio=round(ratio, 1),
        parameters_only_s_per_hour=round(min(alone) / hours, 2),
        parameters_only_ratio=round(min(alone) / plain, 1),
        wall_s=round(benchmark.stats["min"], 2),
    )
    assert hours > 1.0
    errors = [
        (result.parameters[n].value - t) / result.parameters[n].sigma
        for n, t in zip(NAMES, truth.parameters, strict=True)
    ]
    assert np.abs(errors).max() < 4.0
    assert ratio < 13.0
    assert min(alone) / plain < 10.0


def processor_time(arguments):
    """Return the CPU time of a command line in a process of its own, s."""
    import resource  # not on Windows

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, *arguments], check=False, capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stderr
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.mark.timeout(1200)
@pytest.mark.skipif(sys.platform == "win32", reason="CPU times of child processes need POSIX")
def test_command_for_a_one_hour_log_costs_little_more_than_its_solution(hour, benchmark, figures):
    path, _ = hour
    command = ["-m", "calstation", "resolve", str(path), "--json", str(path.with_suffix(".json"))]
    resolve(path, stages=("azimuth_flip",))
    plain, solving, total = plain_pass(path), [], []
    for _ in range(3):
        begin = process_time()
        resolve(path)
        solving.append(process_time() - begin)
    benchmark.pedantic(lambda: total.append(processor_time(command)), rounds=3)
    help_, parser = (
        min(processor_time(each) for _ in range(3)) for each in (["-m", "calstation", "--help"], ["-c", "import typer"])
    )
    figures(
        command_s=round(min(total), 2),
        wall_s=round(benchmark.stats["min"], 2),
        ratio_to_plain_pass=round(min(total) / plain, 1),
        start_s=round(min(total) - min(solving), 2),
        help_ratio_to_import_of_typer=round(help_ / parser, 2),
    )
    assert min(total) / plain < 32.0
    assert help_ / parser < 2.5
