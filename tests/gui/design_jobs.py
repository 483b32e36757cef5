"""Fake schedule searches that end immediately, wait for their stop file, or fail."""

import time
from dataclasses import replace

import numpy as np

from calstation.designer import Design, DesignRequest, Variation
from calstation.errors import ConfigurationError
from calstation.estimation.effects import EffectLimit
from calstation.jobs import ProgressCallback
from calstation.physics import INDEX, NAMES

MOVES = (
    (0.0, 0.0, 6.0),
    (90.0, 180.0, 2.0),
    (180.0, 0.0, 2.0),
    (90.0, -90.0, 4.0),
    (-90.0, 90.0, 2.0),
    (0.0, 0.0, 4.0),
)


def design() -> Design:
    """Return a design of four moves plus two spare ones, limited by accelerometer bias y of three parameters."""
    limits, sigma = np.full(30, np.inf), np.full(30, 1e-6)
    for name, limit, ratio in (
        ("gyro_bias_x", 1e-5, 0.5),
        ("accel_bias_y", 6e-3, 0.78),
        ("accel_scale_z", 1e-4, 0.25),
    ):
        limits[INDEX[name]], sigma[INDEX[name]] = limit, ratio * limit
    return Design(
        moves=MOVES,
        planned=4,
        searched=True,
        rate_dps=60.0,
        acceleration_dps2=60.0,
        duration=33.0,
        longest=48.0,
        margin=0.8,
        sigma=sigma,
        limits=limits,
        stop_targets=None,
        present=330.0,
        front=((10.0, 20.0), (20.0, 2.0), (30.0, 0.9)),
        variations=(
            Variation("mounting", 0.0302, 33.0, 0.9),
            Variation("mounting", 0.0302, 40.0, 0.95),
            Variation("heading", float(np.pi / 2), None, 1.25),
            Variation("noise", 1.5, 48.0, 0.99),
        ),
        undetermined=(),
        hidden=(
            EffectLimit("g_sensitivity", "yy", "", "", 8e-5, "rad·s/m", "gyro_scale_y", 2.77),
            EffectLimit("drift_throughout", "", "gyro_bias_z", "", 4.3e-4, "rad/s", "gyro_bias_z", 10.1),
            EffectLimit("time_skew", "", "", "", float("inf"), "s", "", 0.0),
        ),
        rests=(6.0, 2.0, 2.0, 4.0),
        gravity_rest=None,
        latitude_sigma=float(np.deg2rad(0.5)),
        noise_seen=0.09,
        seconds=41.0,
    )


def found(report: ProgressCallback, request: DesignRequest) -> Design:
    """End immediately."""
    return design()


def incomplete(report: ProgressCallback, request: DesignRequest) -> Design:
    """End immediately with a design that does not determine a parameter."""
    return replace(design(), undetermined=("gyro_bias_z",))


def random_moves(report: ProgressCallback, request: DesignRequest) -> Design:
    """End with random moves, which reach the limits before the search has found another schedule."""
    return replace(design(), front=(), searched=False)


def searching(report: ProgressCallback, request: DesignRequest) -> Design:
    """Report a schedule and continue until the stop file exists."""
    assert request.stop is not None
    note = "34.1" if request.duration is None else "0.823"
    while not request.stop.exists():
        report(0.4, note=note)
        time.sleep(0.02)
    report(0.9, note="checking")
    return design()


def begun(report: ProgressCallback, request: DesignRequest) -> Design:
    """Report the begin of a search, and continue until the stop file exists."""
    assert request.stop is not None
    while not request.stop.exists():
        report(0.01, None if request.time_limit is None else 100.0)
        time.sleep(0.02)
    return design()


def unreachable(report: ProgressCallback, request: DesignRequest) -> Design:
    """Fail like a search whose limits are too small."""
    raise ConfigurationError("design.unreachable", parameter=NAMES[0], limit=1.0, least=2.5, unit="°/h")
