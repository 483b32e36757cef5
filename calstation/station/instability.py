"""How far bias instability widens an excitation's errors: the filter's gains driven by the bench's own noise.

The filter stands in for flicker by a random walk of the bias. Which error that leaves is linear algebra: with the
gains K it computed, its error e and the bank of Gauss-Markov processes β behind the true bias obey

    e⁺ = (I − KH)(F e + F_b β) + noise,      β⁺ = A β + ν,

whose joint covariance is propagated here (Gelb, *Applied Optimal Estimation*, 1974, section 7.2: sensitivity
of a suboptimal filter). Nothing is fitted to the study's errors.
"""

import numpy as np
from scipy.linalg import block_diag

from calstation.bench.noise_truth import INSTABILITY_TIMES, instability_variance
from calstation.estimation.context import Belief, SolveContext
from calstation.estimation.navigation import NavigationFilter
from calstation.estimation.relinearise import solve_navigation
from calstation.estimation.samples import SampleBlock
from calstation.estimation.stage_data import StageData, stage_data
from calstation.physics.arrays import FloatArray
from calstation.physics.parameters import NAMES, group_indices
from calstation.physics.strapdown import PARAMETER_START, STATES

BIAS = [PARAMETER_START + i for i in (*group_indices("gyro_bias"), *group_indices("accel_bias"))]


class MismatchedCovariance:
    """Joint covariance of the filter's error and the true bias processes, advanced beside a filter's pass."""

    def __init__(self, run: NavigationFilter, context: SolveContext) -> None:
        imu = context.imu
        levels = [imu.gyro_bias_instability] * 3 + [imu.accel_bias_instability] * 3
        variance = np.repeat([float(instability_variance(b)) for b in levels], len(INSTABILITY_TIMES))
        times = np.tile(INSTABILITY_TIMES, len(levels))
        self._decay = np.exp(-run.stride * run.dt / times)
        self._driven = variance * (1.0 - self._decay**2)
        self._into_bias = np.kron(np.eye(len(levels)), np.ones(len(INSTABILITY_TIMES)))
        self.P = block_diag(run.kf.P, np.diag(variance))

    def advance(self, run: NavigationFilter) -> None:
        """One observation interval, with the transition, gain and observation that `run` has just used."""
        kf = run.kf
        I_KH = np.eye(STATES) - kf.K @ kf.H
        moved = kf.F.copy()
        moved[PARAMETER_START:, PARAMETER_START:] = np.eye(STATES - PARAMETER_START)
        into = kf.F[:, BIAS] @ self._into_bias
        into[PARAMETER_START:] = 0.0
        T = np.block(
            [[I_KH @ moved, I_KH @ into], [np.zeros((len(self._decay), STATES)), np.diag(self._decay)]]
        )
        white = kf.Q.copy()
        white[PARAMETER_START:, PARAMETER_START:] = 0.0
        noise = block_diag(I_KH @ white @ I_KH.T + kf.K @ kf.R @ kf.K.T, np.diag(self._driven))
        self.P = T @ self.P @ T.T + noise


def instability_ratio(block: SampleBlock, context: SolveContext, prior: Belief) -> FloatArray:
    """Covariance of an excitation's error under the bench's noise, in units of the filter's sigmas, shape (30, 30).

    `prior` : mean at the true parameters, covariance of the prior
    """
    data: StageData = stage_data([block], context.imu)
    settled = solve_navigation("excitation", data, context, prior, np.zeros(len(NAMES), dtype=np.bool_))
    run = NavigationFilter(context, prior, prior.mean)
    start, attitude = settled.starts[0], settled.attitudes[0]
    true: list[MismatchedCovariance] = []

    def after(filtered: NavigationFilter) -> None:
        if not true:
            true.append(MismatchedCovariance(filtered, context))
        else:
            true[0].advance(filtered)

    run.run(data, start, attitude, True, after)
    sigma = run.belief.sigma
    parameters = slice(PARAMETER_START, STATES)
    return np.asarray(true[0].P[parameters, parameters] / np.outer(sigma, sigma))
