"""The information of segments agrees with the filter that it is derived from."""

import numpy as np
import pytest

from calstation.estimation.common import (
    ImuModel,
    PlannedSamples,
    Posterior,
    Site,
    SolveContext,
    TableModel,
    stage_data,
    starts,
)
from calstation.estimation.effects import EffectTests
from calstation.estimation.navigation import (
    ClosedLoopFilter,
    advance_information,
    join_segments,
    result_sensitivity,
    segment_information,
    sigmas,
    solve_navigation,
)
from calstation.physics import COUNT, EFFECTS, NAMES, PARAMETERS, Dwell, Move

IMU = ImuModel("unit", 100.0, "rate", 1e-8, 1e-7, 6e-6, 2e-4, 1e-6, 1e-4)
STEPS = [
    Dwell(6.0),
    Move(1.5, 0.0, 1.5, 2.5),
    Dwell(2.0),
    Move(1.5, 1.5, 1.5, 2.5),
    Dwell(2.0),
    Move(-1.5, 0.7, 1.5, 2.5),
    Dwell(2.0),
    Move(0.0, 3.0, 1.5, 2.5),
    Dwell(3.0),
]


@pytest.fixture(scope="module")
def setting():
    context = SolveContext(Site(0.6, 1.9, 0.0, azimuth=0.0), IMU, TableModel())
    prior = Posterior(np.zeros(COUNT), np.diag([p.prior_sigma**2 for p in PARAMETERS]))
    samples = PlannedSamples(context, prior.mean, np.full(3, 0.005))
    blocks = [
        block for step in STEPS for block in samples.run(step, 4.0 if isinstance(step, Move) else step.duration, "s")
    ]
    data = stage_data(blocks, IMU)
    (start,) = starts(data, context, prior)
    return context, prior, data, start


def test_segment_information_gives_the_covariance_of_the_filter(setting):
    context, prior, data, start = setting
    segment = segment_information(ClosedLoopFilter(context, prior, prior.mean), data, start, context, ())
    end = advance_information(segment.start[None], segment.motion[None])
    run = ClosedLoopFilter(context, prior, prior.mean)
    list(run.steps(data, start, start.attitude))
    np.testing.assert_allclose(sigmas(end, segment.states)[0], run.posterior.sigma, rtol=1e-5)


def test_joining_segments_is_associative(setting):
    context, prior, data, start = setting
    segment = segment_information(ClosedLoopFilter(context, prior, prior.mean), data, start, context, ())
    m, part = segment.states, segment.motion
    left = join_segments(join_segments(part, part, m), part, m)
    right = join_segments(part, join_segments(part, part, m), m)
    stepwise = segment.start[None]
    for _ in range(3):
        stepwise = advance_information(stepwise, part[None])
    for triple in (left, right):
        output = sigmas(advance_information(segment.start[None], triple[None]), m)
        np.testing.assert_allclose(output, sigmas(stepwise, m), rtol=1e-6)


def test_undetectable_effect_sizes_agree_with_the_score_tests(setting):
    context, prior, data, start = setting
    effects = tuple(c for c in EFFECTS if c.cause in ("gyro_asymmetry", "accel_cubic", "g_sensitivity"))
    segment = segment_information(ClosedLoopFilter(context, prior, prior.mean), data, start, context, effects)
    output = sigmas(advance_information(segment.start[None], segment.motion[None]), segment.states)[0, COUNT:]
    mask = np.ones(COUNT, dtype=bool)
    result = solve_navigation(data, context, prior, mask)
    tests = EffectTests(prior.sigma)
    tests.add("s", result_sensitivity(result, data, context, mask), NAMES)
    limits = [
        x.size for c in effects for x in tests.limits(result.posterior, 1.0) if x.cause == c.cause and not x.stage
    ]
    np.testing.assert_allclose(output, limits, rtol=0.02)
