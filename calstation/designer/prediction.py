"""Prediction of the sigmas over temperature.

The information of cycles of moves is computed by solving noise-free samples. It determines the joint covariance of the
polynomial coefficients for given temperatures of the unit, and hence the sigmas over the range.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calstation.estimation.common import PlannedSamples, Posterior, SampleBlock, TemperatureModel, stage_data
from calstation.estimation.navigation import NavigationStage
from calstation.estimation.temperature import TemperaturePoint, held_out_points, predicted_covariance, with_ways
from calstation.physics import COUNT, GROUPS, Dwell, FloatArray, Move, group_indices
from calstation.records import LogMeta, context_from_meta, prior_from_meta
from calstation.sequencer import step_time
from procedures import method

_STAGE = "temperature"
#: Assumed orders of groups whose order the data will determine: biases and scale factors, and other groups without
#: lever arms.
_HIGH, _LOW = 4, 2
#: Duration of the end of a soak that is solved together with the moves, s.
_BEFORE = 20.0
#: Assumed mounting error about each axis, in multiples of the profile's mount sigma.
_MOUNT = 0.3


class Prediction:
    """Predicts the sigmas over the range from the temperatures of cycles of moves."""

    def __init__(self, meta: LogMeta, model: TemperatureModel, steps: Sequence[Move | Dwell], settle: float) -> None:
        """Create a prediction.

        Parameters
        ----------
        meta : configuration of the log
        model : orders of the polynomials
        steps : moves and rests of a cycle
        settle : settling time after a move, s
        """
        self._context, self._prior = replace(context_from_meta(meta), diagnostics=False), prior_from_meta(meta)
        self._model, self._steps, self._settle = model, steps, settle
        self._posteriors: dict[tuple[int, bool], Posterior] = {}

    def posterior(self, cycles: int, *, after_soak: bool = True) -> Posterior:
        """Return the solution of cycles of moves, by default with the end of a soak."""
        if (cycles, after_soak) not in self._posteriors:
            mount, steps = np.full(3, _MOUNT * self._context.table.mount_sigma), list(self._steps) * cycles
            if after_soak:
                steps = [self._steps[0], Dwell(_BEFORE), *steps]
            samples = PlannedSamples(self._context, self._prior.mean, mount)
            blocks: list[SampleBlock] = []
            for step in steps:
                blocks += samples.run(step, step_time(step, samples.joints, self._settle), _STAGE)
            solver = NavigationStage(_STAGE, self._context, self._prior, method(_STAGE).estimates(self._context))
            solved = solver.solve(stage_data(blocks, self._context.imu)).posterior
            self._posteriors[cycles, after_soak] = Posterior(self._prior.mean, solved.covariance)
        return self._posteriors[cycles, after_soak]

    def sigmas(self, visits: Sequence[tuple[float, float]], cycles: int = 1, *, after_soak: bool = True) -> FloatArray:
        """Return the sigmas at the temperatures of the range, SI, shape (n, 30).

        Parameters
        ----------
        visits : temperature, °C, and its rate, K/s, of every solution
        cycles : number of cycles of a solution
        after_soak : whether the end of a soak precedes each solution's moves
        """
        model, posterior = self._model, self.posterior(cycles, after_soak=after_soak)
        points = with_ways([TemperaturePoint(t, rate, 0.0, "soak", 0, 0, self._prior, posterior) for t, rate in visits])
        covariance = predicted_covariance(model, held_out_points(points, model.held_out), self._prior)
        x = (model.temperatures - model.reference) / model.span
        variances = np.zeros((len(x), COUNT))
        for i in range(COUNT):
            columns = [k for k, c in enumerate(model.columns) if c.parameter == i and c.power is not None]
            powers = np.stack([x ** float(model.columns[k].power or 0) for k in columns], axis=1)
            variances[:, i] = np.sum(powers @ covariance[np.ix_(columns, columns)] * powers, axis=1)
        gravity = self._context.site.relative_gravity_sigma
        variances[:, list(group_indices("accel_scale"))] += gravity**2
        return np.sqrt(variances)


def with_assumed_orders(model: TemperatureModel) -> TemperatureModel:
    """Return the model with assumed orders of the groups whose order the data determine."""
    if not model.is_automatic:
        return model
    for group in GROUPS:
        if group not in model.order and not group.endswith("_lever"):
            model = model.with_order(group, _HIGH if group.endswith(("_bias", "_scale")) else _LOW)
    return model


def optimal_nodes(count: int) -> FloatArray:
    """Return the nodes in [-1, 1] that minimise the largest sigma of a polynomial with `count` coefficients.

    The sigma of the polynomial then nowhere in [-1, 1] exceeds that of a measurement (Guest, Ann. Math. Stat. 29,
    1958).
    """
    inner = np.polynomial.legendre.Legendre.basis(count - 1).deriv().roots()
    return np.concatenate([[-1.0], np.sort(inner.real), [1.0]])
