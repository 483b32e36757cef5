"""Increase of an excitation stage's errors due to bias instability, given the filter's gains and the bench's noise.

The filter models flicker noise by one Gauss-Markov process per bias. With the filter's gains K, the error e of its
estimate (without the true bias drift) and the processes β that drive the true biases are

    e⁺ = (I − KH)(F e − [F_b; 0] β) + K H_b β⁺ + noise,      β⁺ = A β + ν,

and their joint covariance is propagated (Gelb, *Applied Optimal Estimation*, 1974, section 7.2: sensitivity of a
suboptimal filter). No value is fitted to the errors of the study.
"""

import numpy as np
from scipy.linalg import block_diag

from calstation.bench.truth import INSTABILITY_TIMES, instability_variance
from calstation.estimation.common import Posterior, SampleBlock, SolveContext, StageData, stage_data
from calstation.estimation.navigation import BIAS, ReferencePass, solve_navigation
from calstation.physics import NAMES, NAVIGATION, PARAMETER_STATES, STATES, FloatArray


class MismatchedCovariance:
    """Joint covariance of the filter's error and the true bias processes, propagated over one pass of the filter."""

    def __init__(self, run: ReferencePass, context: SolveContext) -> None:
        imu = context.imu
        levels = [imu.gyro_bias_instability] * 3 + [imu.accel_bias_instability] * 3
        variance = np.repeat([float(instability_variance(b)) for b in levels], len(INSTABILITY_TIMES))
        times = np.tile(INSTABILITY_TIMES, len(levels))
        self._times, self._variance = times, variance
        self._bias_sum = np.kron(np.eye(len(levels)), np.ones(len(INSTABILITY_TIMES)))
        start = run.state.P.copy()
        start[STATES:], start[:, STATES:] = 0.0, 0.0
        self.P = block_diag(start, np.diag(variance))

    def advance(self, run: ReferencePass) -> None:
        """Propagate over one group of observations with the last transition, gain and Jacobian of `run`."""
        group, root = run.group, run.last_updates.root[0]
        gain = np.linalg.solve(root.T, run.last_updates.gain[0]).T
        decay = np.exp(-len(group.z) // 3 * run.stride * run.dt / self._times)
        size = len(run.state.x)
        I_KH = np.eye(size) - gain @ group.H
        bias_transition = np.zeros((size, len(BIAS)))
        bias_transition[NAVIGATION] = group.transition[NAVIGATION, BIAS]
        bias_gain = gain @ group.H[:, BIAS] @ self._bias_sum
        T = np.block(
            [
                [I_KH @ group.transition, -I_KH @ bias_transition @ self._bias_sum + bias_gain * decay],
                [np.zeros((len(decay), size)), np.diag(decay)],
            ]
        )
        white = group.noise.copy()
        white[STATES:, STATES:] = 0.0
        driven = np.vstack([bias_gain, np.eye(len(decay))])
        noise = driven @ np.diag(self._variance * (1.0 - decay**2)) @ driven.T
        shared = I_KH @ group.M @ gain.T
        noise[:size, :size] += I_KH @ white @ I_KH.T + gain @ group.R @ gain.T - shared - shared.T
        self.P = T @ self.P @ T.T + noise


def normalised_error_covariance(block: SampleBlock, context: SolveContext, prior: Posterior) -> FloatArray:
    """Return the error covariance under the bench's noise, normalised by the filter's sigmas, shape (30, 30).

    Parameters
    ----------
    block : samples of the stage
    context : context of the solver
    prior : prior of the stage, whose mean must be the true parameters
    """
    data: StageData = stage_data([block], context.imu)
    solution = solve_navigation(data, context, prior, np.zeros(len(NAMES), dtype=np.bool_))
    run = ReferencePass(context, prior, prior.mean)
    start, attitude = solution.starts[0], solution.attitudes[0]
    steps = run.steps(data, start, attitude, batch=1)
    next(steps)
    true = MismatchedCovariance(run, context)
    for _ in steps:
        true.advance(run)
    sigma = run.posterior.sigma
    return np.asarray(true.P[PARAMETER_STATES, PARAMETER_STATES] / np.outer(sigma, sigma))
