"""Trial of a schedule with the plan and the filter of a run, without devices, under planned and other conditions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import BaseModel

from calstation.designer.design import STAGE, Variation
from calstation.estimation import Solution
from calstation.estimation.common import PlannedSamples, SampleBlock, SolveContext, stage_data
from calstation.estimation.effects import MAX_EXCESS, EffectLimit, EffectTests, known_effects, plausible_changes
from calstation.estimation.navigation import result_sensitivity, solve_navigation
from calstation.judgement import undetermined
from calstation.physics import NAMES, Dwell, FloatArray, Move, RoundEnd, TableGeometry
from calstation.records import LogMeta, context_from_meta, prior_from_meta
from calstation.results import StageChain
from calstation.sequencer import step_time
from procedures import method

Moves = Sequence[tuple[float, float, float]]

#: Factor of the profiles' noise at which a schedule must still reach its targets.
NOISE_FACTOR = 1.5
#: Assumed mounting error about each axis, in multiples of the profile's mount sigma.
_MOUNT = 0.3
#: Other mounting errors, in multiples of the profile's mount sigma.
_MOUNTS = ((1.0, -1.0, 1.0), (-1.0, 1.0, 1.0))
#: Other headings of the table, rad.
_HEADINGS = tuple(np.deg2rad([90.0, 200.0]))


@dataclass(frozen=True)
class Condition:
    """A condition other than the planned one; `name` and `value` are as in `Variation`."""

    name: str
    value: float
    context: SolveContext
    mount: FloatArray  #: Mounting rotation, rad, shape (3,).


class Trial:
    """Simulates the moves of a schedule."""

    def __init__(self, meta: LogMeta, geometry: TableGeometry, settle: float, rate: float, acceleration: float) -> None:
        """Create a trial from a log configuration; `settle` is in s, `rate` and `acceleration` in °/s and °/s²."""
        self._meta, self._geometry, self._settle = meta, geometry, settle
        self._rate, self._acceleration = rate, acceleration
        self._context, self._prior = context_from_meta(meta), prior_from_meta(meta)
        sigma = self._context.table.mount_sigma
        self.mount = np.full(3, _MOUNT * sigma)
        self._mounts = [np.array(m) * sigma for m in _MOUNTS]

    def after_moves(
        self, moves: Moves, context: SolveContext | None = None, mount: FloatArray | None = None
    ) -> Iterator[tuple[float, FloatArray]]:
        """Yield time, s, and sigmas, SI, shape (30,), after every move and its rest.

        Parameters
        ----------
        moves : moves of the schedule, as angles, degrees, and rests, s
        context : context of the solver; None for the planned one
        mount : mounting rotation, rad, shape (3,); None for the planned one
        """
        context = context or self._context
        schedule = self._schedule(moves)
        solver = method(STAGE).solver(context, self._prior, schedule)
        for time, block in self._blocks(moves, context, self.mount if mount is None else mount):
            if block is None:
                yield time, solver.sigma()
            else:
                solver.feed(block)

    def _schedule(self, moves: Moves) -> BaseModel:
        speeds = {"rate_dps": self._rate, "acceleration_dps2": self._acceleration}
        return method(STAGE).schedule(moves=[tuple(m) for m in moves], stop_at_limits=False, **speeds)

    def _blocks(
        self, moves: Moves, context: SolveContext, mount: FloatArray
    ) -> Iterator[tuple[float, SampleBlock | None]]:
        """Yield the time and samples of every move and its rest, followed by the time and None."""
        samples = PlannedSamples(context, self._prior.mean, mount)
        time = 0.0
        for step in method(STAGE).plan(self._geometry, self._schedule(moves)):
            if isinstance(step, RoundEnd):
                yield time, None
            elif isinstance(step, Move | Dwell):
                seconds = step_time(step, samples.joints, self._settle)
                time += seconds
                for block in samples.run(step, seconds, STAGE):
                    yield time, block

    def solve(self, moves: Moves) -> tuple[Solution, tuple[str, ...], tuple[EffectLimit, ...]]:
        """Solve the moves as in a run.

        Also return the parameters that the moves do not determine, and the size of each effect below which they do not
        detect it.
        """
        chain = StageChain(self._meta)
        chain.start(STAGE)
        blocks = [block for _, block in self._blocks(moves, self._context, self.mount) if block is not None]
        for block in blocks:
            chain.feed(block)
        solution = chain.finish()
        names = undetermined(chain.prior, [solution], self._meta.calibrated)
        return solution, tuple(names), self._hidden(blocks)

    def _hidden(self, blocks: Sequence[SampleBlock]) -> tuple[EffectLimit, ...]:
        """Return the detection limit of every constant effect, and of every parameter group that may drift.

        Of several components, the one that causes the largest error is returned. The noise is that of the profiles,
        because the samples are noise-free.
        """
        names = method(STAGE).estimates(self._context)
        mask = np.array([name in names for name in NAMES])
        data = stage_data(list(blocks), self._context.imu)
        solution = solve_navigation(data, self._context, self._prior, mask)
        priors = known_effects(self._prior.sigma, self._context)
        changes = plausible_changes(self._context.imu, self._meta.turn_on_sigmas)
        tests = EffectTests(changes, self._context.states, priors)
        tests.add(STAGE, result_sensitivity(solution, data, self._context, mask), names)
        largest: dict[tuple[str, str], EffectLimit] = {}
        for limit in tests.limits(solution.posterior, MAX_EXCESS + 1.0):
            key = limit.cause, limit.parameter.rpartition("_")[0]
            if not limit.stage and (key not in largest or limit.move > largest[key].move):
                largest[key] = limit
        return tuple(largest.values())

    def conditions(self) -> Iterator[Condition]:
        """Yield conditions other than the planned one."""
        site, imu, table = self._context.site, self._context.imu, self._context.table
        for mount in self._mounts:
            yield Condition("mounting", float(np.linalg.norm(mount)), self._context, mount)
        for heading in _HEADINGS if site.azimuth is not None else ():
            context = replace(self._context, site=replace(site, azimuth=site.azimuth + heading))
            yield Condition("heading", float(heading), context, self.mount)
        noisy = replace(imu, gyro_arw=NOISE_FACTOR * imu.gyro_arw, accel_vrw=NOISE_FACTOR * imu.accel_vrw)
        vibrating = replace(table, velocity_sigma=NOISE_FACTOR * table.velocity_sigma)
        yield Condition("noise", NOISE_FACTOR, replace(self._context, imu=noisy, table=vibrating), self.mount)

    def under(self, condition: Condition, moves: Moves, goal: FloatArray) -> Variation:
        """Return the time at which the sigmas reach a goal under a condition.

        Parameters
        ----------
        condition : condition other than the planned one
        moves : moves of the schedule, as angles, degrees, and rests, s
        goal : sigmas to be reached, SI, shape (30,)
        """
        worst = np.inf
        for time, sigma in self.after_moves(moves, condition.context, condition.mount):
            worst = float(np.max(sigma / goal))
            if worst <= 1.0:
                return Variation(condition.name, condition.value, float(time), worst)
        return Variation(condition.name, condition.value, None, worst)
