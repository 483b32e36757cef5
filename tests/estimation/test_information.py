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
from calstation.estimation.effects import EffectTests, drifts_before_end
from calstation.estimation.navigation import (
    ClosedLoopFilter,
    Drifts,
    advance_information,
    join_segments,
    precision,
    result_sensitivity,
    segment_information,
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
    return moved(STEPS)


def moved(steps):
    """Return the context, the prior, the samples of the steps, and the start."""
    context = SolveContext(Site(0.6, 1.9, 0.0, azimuth=0.0), IMU, TableModel())
    prior = Posterior(np.zeros(COUNT), np.diag([p.prior_sigma**2 for p in PARAMETERS]))
    samples = PlannedSamples(context, prior.mean, np.full(3, 0.005))
    blocks = [
        block for step in steps for block in samples.run(step, 4.0 if isinstance(step, Move) else step.duration, "s")
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
    np.testing.assert_allclose(precision(end, segment.states).sigma[0], run.posterior.sigma, rtol=1e-5)


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
        output = precision(advance_information(segment.start[None], triple[None]), m).sigma
        np.testing.assert_allclose(output, precision(stepwise, m).sigma, rtol=1e-6)


def test_drift_over_several_segments_is_that_over_the_whole_motion(setting):
    context, prior, data, start = setting
    effects = tuple(drifts_before_end())
    drifts = Drifts.among(effects)
    segment = segment_information(ClosedLoopFilter(context, prior, prior.mean), data, start, context, effects)
    m, part, seconds = segment.states, segment.motion, len(data) * data.dt
    stepwise = segment.start[None]
    for _ in range(3):
        stepwise = advance_information(stepwise, part[None], seconds, drifts)
    double = join_segments(part, part, m, seconds, drifts)
    joined = advance_information(
        advance_information(segment.start[None], double[None], 2.0 * seconds, drifts), part[None], seconds, drifts
    )
    for output, expected in zip(precision(joined, m), precision(stepwise, m), strict=True):
        np.testing.assert_allclose(output, expected, rtol=1e-5, atol=1e-9 * np.abs(expected).max())
    # a drift that continues is easier to detect than that of one of three equal motions
    alone = precision(advance_information(segment.start[None], part[None], seconds, drifts), m).size_sigma
    assert np.all(precision(stepwise, m).size_sigma < alone / 3.0)


def test_error_of_an_undetectable_drift_agrees_with_the_score_tests():
    context, prior, data, start = moved(3 * STEPS)
    effects = tuple(drifts_before_end())
    segment = segment_information(ClosedLoopFilter(context, prior, prior.mean), data, start, context, effects)
    output = precision(advance_information(segment.start[None], segment.motion[None]), segment.states)
    errors = np.max(np.abs(output.error[0]) / output.sigma[0][:, None], axis=0) * output.size_sigma[0]
    mask = np.ones(COUNT, dtype=bool)
    result = solve_navigation(data, context, prior, mask)
    tests = EffectTests(prior.sigma)
    tests.add("s", result_sensitivity(result, data, context, mask), NAMES)
    ramps = [x for x in tests.limits(result.posterior, 1.0) if x.cause == "drift_throughout"][::2]
    assert [x.parameter for x in ramps] == [p for effect in effects for p in effect.parameters]
    np.testing.assert_allclose(errors, [x.move for x in ramps], rtol=0.03)


def test_undetectable_effect_sizes_agree_with_the_score_tests(setting):
    context, prior, data, start = setting
    effects = tuple(c for c in EFFECTS if c.cause in ("gyro_asymmetry", "accel_cubic", "g_sensitivity"))
    segment = segment_information(ClosedLoopFilter(context, prior, prior.mean), data, start, context, effects)
    end = advance_information(segment.start[None], segment.motion[None])
    output = precision(end, segment.states).size_sigma[0]
    mask = np.ones(COUNT, dtype=bool)
    result = solve_navigation(data, context, prior, mask)
    tests = EffectTests(prior.sigma)
    tests.add("s", result_sensitivity(result, data, context, mask), NAMES)
    limits = [
        x.size for c in effects for x in tests.limits(result.posterior, 1.0) if x.cause == c.cause and not x.stage
    ]
    np.testing.assert_allclose(output, limits, rtol=0.02)
