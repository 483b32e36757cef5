"""Design of a schedule for a product on a station: search, and verification of the result with the solver of a run."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Never

import numpy as np

from calstation.config import DetectionSection, RunRequest, check_manual_rig, load_configuration
from calstation.designer.design import (
    SERIAL,
    STAGE,
    Design,
    DesignRequest,
    Variation,
    gravity_rest,
    speeds,
    stages_duration,
)
from calstation.designer.search import Beam, Exchange, Front, Problem, Stop, Stops, durations, shortest_walk, states
from calstation.designer.segments import LATTICE_DEG, REST_UNIT, Conditions, Position, SegmentLibrary
from calstation.designer.trial import NOISE_FACTOR, Moves, Trial
from calstation.errors import ConfigurationError
from calstation.estimation.common import without_gravity
from calstation.estimation.effects import drifts_before_end
from calstation.jobs import ProgressCallback
from calstation.physics import COUNT, DISPLAY, EFFECTS, NAMES, OBSERVABLE, PARAMETERS, FloatArray, Move
from calstation.records import context_from_meta, prior_from_meta
from calstation.results import compute_preview, one_blas_thread
from calstation.sequencer import check_limits
from procedures import method

#: Largest angle of a joint from home, °, even if its travel is longer, because of cables and the time to return.
_MAX_ANGLE_DEG = 360.0
#: Angles by which a joint turns in a move, in lattice units, if the travel permits a full turn, and otherwise.
_TURNS, _SHORT_TURNS = (-8, -4, -2, -1, 0, 1, 2, 4, 8), (-6, -4, -3, -2, -1, 0, 1, 2, 3, 4, 6)
#: Widths of successive beams: the first gives a result quickly, and the last is repeated; number of beams without a
#: time limit.
_WIDTHS, _BEAMS = (6, 24, 48, 96, 192), 2
#: Width of the beam that adds the reserve.
_RESERVE_WIDTH = 8
#: Number of exchange steps after each beam.
_EXCHANGES = 1500
#: Largest number of corrections of the difference between segments and filter.
_CORRECTIONS = 4
#: Largest ratio of detectable to required effect size, with a tolerance for the error of the segment approximation.
_MAX_DETECTION_RATIO = 1.02
#: Number of rests used by the product's gravity check.
_GRAVITY_RESTS = 3
#: Fractions of the work completed before the first beam, the reserve and the verification.
_PROBE_END, _SEARCHED, _RESERVED = 0.02, 0.9, 0.95
#: Factor by which each step of the search for the smallest sigmas reduces the targets, and the number of steps.
_TARGET_REDUCTION, _STEPS = 0.95, 8
#: Factor of the targets of the first beam of this search, which makes them unreachable.
_UNREACHABLE_FACTOR = 0.05
#: Factor of the targets that compensates for the difference between segments and filter.
_TARGET_TIGHTENING = 0.97
#: Longest duration of a schedule with its reserve, as a multiple of the schedule's duration.
_MAX_DURATION_RATIO = 4.0


def design_schedule(report: ProgressCallback, request: DesignRequest) -> Design:
    """Job: find the shortest schedule that meets the limits of a product, or the best one for a given duration.

    Raises ConfigurationError if the limits cannot be reached within an hour, naming the parameter and the achievable
    value.
    """
    with one_blas_thread():
        return _Designer(report, request).run()


class _Designer:
    def __init__(self, report: ProgressCallback, request: DesignRequest) -> None:
        self._report, self._request = report, request
        self._start_time = time.monotonic()
        report(0.0, self._remaining)
        present = RunRequest(SERIAL, request.station, request.product)
        schedule = {STAGE: {"stop_at_limits": False}}
        setup = load_configuration(replace(present, stages=(STAGE,), schedule=schedule))
        check_manual_rig(setup)
        self._meta = setup.log_meta()
        self._geometry, self._settle = setup.table.geometry(), setup.table.settle_s
        self._table = setup.table.name
        self._context = context_from_meta(self._meta)
        self._product = setup.product
        self._rate_dps, self._acceleration_dps2 = speeds(setup, request)
        rate, acceleration = float(np.deg2rad(self._rate_dps)), float(np.deg2rad(self._acceleration_dps2))
        check_limits(self._geometry.limits, Move(0.0, 0.0, rate, acceleration))
        drifts = {f"{effect.parameters[0].rpartition('_')[0]}_drift": effect for effect in drifts_before_end()}
        known = {effect.cause: effect for effect in EFFECTS} | drifts
        self._effects = {cause: known[cause] for cause in self._product.diagnosis}
        trial = Trial(self._meta, self._geometry, self._settle, self._rate_dps, self._acceleration_dps2)
        self._trial = trial
        prior = prior_from_meta(self._meta)
        self._conditions = Conditions(
            self._context, prior, self._settle, rate, acceleration, trial.mount, tuple(self._effects.values())
        )
        self._library = SegmentLibrary(self._conditions)
        self._limits = self._present_sigmas(present) if request.as_present else self._sigma_limits(setup.sigma_limits())
        #: Fraction of their limits that the sigmas should not exceed.
        self._margin = request.margin if request.duration is None and not request.as_present else 1.0
        self._goal = self._target_sigmas()
        self._determined = {} if request.as_present else self._determined_sigmas(prior.sigma)
        self._front = Front()
        self._searched = request.duration is not None  #: Whether a beam has found a result.
        rest = gravity_rest(self._product, self._context)
        self._gravity_rest = None if rest is None else round(rest / REST_UNIT)
        self._present = stages_duration(load_configuration(present))

    def _sigma_limits(self, limits: dict[str, float]) -> FloatArray:
        estimated = method(STAGE).estimates(self._context)
        required = np.array([limits.get(name, np.inf) if name in estimated else np.inf for name in NAMES])
        if not np.isfinite(required).any():
            raise ConfigurationError("design.no_limits", product=self._product.name)
        return required

    def _present_sigmas(self, present: RunRequest) -> FloatArray:
        """Return the sigmas after the product's current stages."""
        self._report(0.0, note="present")
        last = compute_preview(lambda *_, **__: None, replace(present, out=Path("nowhere"))).stages[-1]
        if last.sigma is None:
            raise ConfigurationError("design.no_present", product=self._product.name)
        estimated = method(STAGE).estimates(self._context)
        return np.where([name in estimated for name in NAMES], last.sigma, np.inf)

    def _target_sigmas(self) -> FloatArray:
        """Return the target sigmas of the stage, shape (30,): the limits times the margin without the gravity error."""
        relative = self._context.site.relative_gravity_sigma
        targets = without_gravity(self._margin * self._limits, relative)
        for i in np.flatnonzero(targets <= 0.0):
            self._refuse("design.gravity", int(i), relative)
        return targets

    def _determined_sigmas(self, prior: FloatArray) -> dict[int, float]:
        """Return the sigmas at which parameters are determined, by index, where these are below the target sigmas."""
        names, sigmas = method(STAGE).estimates(self._context), self._request.margin * OBSERVABLE * prior
        return {
            i: float(sigmas[i]) for i, name in enumerate(NAMES) if name in names and 0.0 < sigmas[i] < self._goal[i]
        }

    def _problem(self, factor: float = 1.0) -> Problem:
        """Return the problem with targets multiplied by `factor`."""
        limits = self._geometry.limits
        low, high = self._lattice(limits.low, up=True), self._lattice(limits.high, up=False)
        full_turn = min(b - a for a, b in zip(low, high, strict=True)) * LATTICE_DEG >= 360.0
        turns = _TURNS if full_turn else _SHORT_TURNS
        shortest = self._request.duration is None and self._gravity_rest is not None
        rests = (self._gravity_rest or 0, _GRAVITY_RESTS) if shortest else (0, 0)
        required = self._required_sizes(), self._required_errors()
        targets = factor * self._goal
        margin = factor * self._margin
        problem = Problem(
            self._library, targets, low, high, turns, margin, *rests, *required, determined=self._determined
        )
        if not any(problem.next_positions((0, 0))):
            raise ConfigurationError("design.no_travel", table=self._table, step_deg=LATTICE_DEG)
        return problem

    def _required(self) -> Iterator[DetectionSection | float]:
        """Yield the requirement of the product for each component of an effect."""
        for cause, effect in self._effects.items():
            yield from len(effect.components) * (self._product.diagnosis[cause],)

    def _required_sizes(self) -> FloatArray:
        """Return the sizes of effects that must be detected, SI, shape (k,); infinite where an error is required."""
        return np.array([each if isinstance(each, float) else np.inf for each in self._required()])

    def _required_errors(self) -> FloatArray:
        """Return the errors at which effects must be detected, SI, shape (30, k); infinite where a size is required."""
        over = [each.error_over_limit if isinstance(each, DetectionSection) else np.inf for each in self._required()]
        return np.outer(self._limits, np.array(over))

    @staticmethod
    def _lattice(ends: tuple[float, float], *, up: bool) -> Position:
        outer, inner = (float(np.clip(np.rad2deg(x), -_MAX_ANGLE_DEG, _MAX_ANGLE_DEG)) / LATTICE_DEG for x in ends)
        rounded = np.ceil if up else np.floor
        return int(rounded(outer)), int(rounded(inner))

    def _refuse(self, code: str, index: int, achievable: float) -> Never:
        unit, size = DISPLAY[PARAMETERS[index].group]
        limit = self._limits[index] / size
        raise ConfigurationError(code, parameter=NAMES[index], limit=limit, least=achievable / size, unit=unit)

    def run(self) -> Design:
        """Search for a schedule, correct it, add the reserve, and verify it."""
        request = self._request
        if request.duration is None:
            stops, factor = self._shortest(), 1.0
            self._report(_SEARCHED, note="checking")
            stops = self._corrected(stops)
            planned = len(stops)
            stops = self._with_reserve(stops)
        else:
            stops, factor = self._best(request.duration)
            planned = len(stops)
        self._report(_RESERVED, note="checking")
        goal, moves = factor * self._goal, _moves(stops)
        times = list(self._trial.after_moves(moves))
        min_moves = self._min_moves(stops[:planned])
        reached = (k for k, (_, sigma) in enumerate(times, 1) if k >= min_moves and np.all(sigma <= goal))
        planned = next(reached, planned)
        solution, undetermined, hidden = self._trial.solve(moves[:planned])
        consistency, latitude = solution.consistency, solution.latitude
        duration = float(times[planned - 1][0])
        front = self._complete_front(duration, float((solution.posterior.sigma / self._limits).max())).points()
        targets = {name: float(s) for name, s in zip(NAMES, goal, strict=True) if np.isfinite(s)}
        return Design(
            moves=moves,
            planned=planned,
            rate_dps=self._rate_dps,
            acceleration_dps2=self._acceleration_dps2,
            duration=duration,
            longest=float(times[-1][0]),
            margin=factor * self._margin,
            sigma=solution.posterior.sigma,
            limits=self._limits,
            stop_targets=targets if request.as_present and request.duration is None else None,
            present=self._present,
            front=tuple((float(seconds), float(worst)) for seconds, worst, _ in front),
            searched=self._searched,
            variations=tuple(self._variations(moves, self._goal)),
            undetermined=undetermined,
            hidden=hidden,
            gravity_rest=None if self._gravity_rest is None else self._gravity_rest * REST_UNIT,
            rests=tuple(stop.rest * REST_UNIT for stop in stops[:planned]),
            latitude_sigma=None if latitude is None else latitude.sigma,
            noise_seen=float(np.sqrt(consistency.nis_high / 3.0) - 1.0),
            seconds=time.monotonic() - self._start_time,
        )

    def _min_moves(self, stops: Stops) -> int:
        """Return the number of moves that every run executes, for requirements that its sigma limits do not cover.

        These moves detect the product's effects, determine every parameter, and contain the rests of the gravity check.
        """
        problem, ends = self._problem(), np.array(states(self._library, stops))
        reveals = np.all(problem.ratios(ends)[:, COUNT:] <= _MAX_DETECTION_RATIO, axis=1)
        has_rests = np.array([problem.has_long_rests(stops[:k]) for k in range(1, len(stops) + 1)])
        sufficient = np.flatnonzero(reveals & has_rests)
        return int(sufficient[0]) + 1 if len(sufficient) else len(stops)

    def _variations(self, moves: Moves, goal: FloatArray) -> Iterator[Variation]:
        """Yield, for each condition other than the planned one, the time at which the sigmas reach `goal`."""
        conditions = list(self._trial.conditions())
        for number, condition in enumerate(conditions):
            self._report(_RESERVED + (1.0 - _RESERVED) * (number + 1) / (len(conditions) + 1), note="checking")
            yield self._trial.under(condition, moves, goal)

    def _shortest(self) -> Stops:
        """Return the shortest schedule found."""
        problem = self._problem()
        present = self._present_stops(problem)
        best = None if present is None else next(self._exchanged(problem, present, 0, np.inf), None)
        if best is None:
            best, ratios = shortest_walk(problem, self._request.seed)
        if best is None:
            self._refuse_unreachable(ratios)
        for number in self._beams():
            for stops in self._attempt(problem, number, self._duration(best)):
                best = min(best, stops, key=self._duration)
        return best

    def _duration(self, stops: Stops) -> float:
        """Return the duration of a schedule, s."""
        return durations(self._library, stops)[-1]

    def _refuse_unreachable(self, ratios: FloatArray) -> Never:
        """Raise the error for targets that are not reached within an hour; `ratios` are as in `Problem.ratios`."""
        parameter = int(np.argmax(ratios[:COUNT]))
        if ratios[parameter] > 1.0:
            self._refuse("design.unreachable", parameter, float(ratios[parameter] * self._goal[parameter]))
        components = ((cause, component) for cause, c in self._effects.items() for component in c.components)
        names = ["_".join(filter(None, each)) for each in components]
        worst = int(np.argmax(ratios[COUNT:]))
        if worst >= len(names):
            raise ConfigurationError("design.undetermined", parameter=NAMES[[*self._determined][worst - len(names)]])
        raise ConfigurationError("design.effect_unreachable", effect=names[worst], times=float(ratios[COUNT + worst]))

    def _beams(self) -> Iterator[int]:
        """Yield the number of the next beam while there is time."""
        number = 0
        while not self._should_stop() and (self._request.time_limit is not None or number < _BEAMS):
            yield number
            number += 1

    def _should_stop(self) -> bool:
        """Return whether the search should end."""
        stop, limit = self._request.stop, self._request.time_limit
        return (stop is not None and stop.exists()) or (
            limit is not None and time.monotonic() - self._start_time > limit
        )

    def _attempt(self, problem: Problem, number: int, longest: float) -> Iterator[Stops]:
        """Yield the results of a beam and of the exchanges that follow it."""
        result: Stops | None = None
        for seconds, stops in Beam(problem, _WIDTHS[min(number, len(_WIDTHS) - 1)], longest, self._front).run():
            self._progress(number, 0.6 * seconds / longest, longest)
            result = stops
            if self._should_stop():
                break
        if result is None:
            return
        self._searched = True
        result = problem.with_long_rests(result)
        self._note(problem, result)
        yield result
        yield from self._exchanged(problem, result, number)

    def _exchanged(self, problem: Problem, stops: Stops, number: int, longest: float | None = None) -> Iterator[Stops]:
        """Yield the schedule improved by exchanges, see `Exchange`, if it reaches the targets."""
        exchange = Exchange(problem, stops, self._request.seed + number, longest)
        for share in exchange.run(_EXCHANGES):
            self._progress(number, 0.6 + 0.4 * share, exchange.time)
            if self._should_stop():
                break
        if exchange.reached:
            self._searched = True
            self._note(problem, exchange.best)
            yield exchange.best

    def _present_stops(self, problem: Problem) -> Stops | None:
        """Return the planned moves of a product with only this stage; None if the search does not permit them."""
        if self._product.stages != [STAGE]:
            return None
        schedule = method(STAGE).schedule(**self._product.schedule.get(STAGE, {})).model_dump()
        moves = np.array(schedule["moves"])[: schedule["least_moves"]] / (LATTICE_DEG, LATTICE_DEG, REST_UNIT)
        stops = tuple(Stop((round(outer), round(inner)), round(rest)) for outer, inner, rest in moves)
        if not np.allclose(moves, np.round(moves)) or stops[0].position != (0, 0) or not problem.permits(stops):
            return None
        return problem.with_long_rests(stops)

    def _note(self, problem: Problem, stops: Stops) -> None:
        """Add a result to the front."""
        self._front.add(self._duration(stops), self._worst(problem, stops), stops)

    def _worst(self, problem: Problem, stops: Stops) -> float:
        """Return the largest ratio of a sigma to its limit after a schedule."""
        return problem.margin * float(problem.ratios(states(self._library, stops)[-1][None])[0, :COUNT].max())

    def _complete_front(self, duration: float, worst: float) -> Front:
        """Return the front of complete schedules, excluding those that seem better than the result.

        The schedules of a beam lack the long rests of the gravity check, and their sigmas differ slightly from those of
        the filter, so that some seem to reach the limits earlier, or smaller ratios in the same time. `duration` and
        `worst` are the duration, s, and the ratio of the result.
        """
        problem, front = self._problem(), Front()
        for _, _, stops in self._front.points():
            complete = problem.with_long_rests(stops)
            seconds, ratio = self._duration(complete), self._worst(problem, complete)
            earlier = seconds < duration and ratio <= self._margin and self._request.duration is None
            if not earlier and (seconds > duration or ratio >= worst):
                front.add(seconds, ratio, complete)
        return front

    @property
    def _remaining(self) -> float | None:
        """Remaining time including the verification, s; None for a search without a time limit."""
        limit = self._request.time_limit
        return None if limit is None else max(limit / _SEARCHED - (time.monotonic() - self._start_time), 0.0)

    def _progress(self, number: int, share: float, best: float) -> None:
        """Report the completed fraction of a beam, and the duration of the best schedule so far, s."""
        limit = self._request.time_limit
        spent = time.monotonic() - self._start_time
        done = (number + share) / _BEAMS if limit is None else min(spent / limit, 1.0)
        note = f"{best:.1f}" if np.isfinite(best) else ""
        self._report(_PROBE_END + (_SEARCHED - _PROBE_END) * done, self._remaining, note)

    def _corrected(self, stops: Stops) -> Stops:
        """Return a schedule that reaches the targets in the filter, which differs slightly from the segments."""
        factor = 1.0
        for _ in range(_CORRECTIONS):
            *_, (_, sigma) = self._trial.after_moves(_moves(stops))
            worst = float(np.max(sigma / self._goal))
            if worst <= 1.0:
                break
            factor /= worst * 1.002
            stops = self._continued(stops, factor)
        return stops

    def _with_reserve(self, stops: Stops) -> Stops:
        """Return a schedule extended until the targets are reached with more noise and under other conditions."""
        conditions = list(self._trial.conditions())
        fractions = np.linspace(_SEARCHED, _RESERVED, len(conditions) + 2)[1:]
        self._report(fractions[0], note="checking")
        stops = self._continued(stops, 1.0 / NOISE_FACTOR)
        for fraction, condition in zip(fractions[1:], conditions, strict=True):
            self._report(fraction, note="checking")
            if self._trial.under(condition, _moves(stops), self._goal).duration is None:
                other = replace(self._conditions, context=condition.context, mount=condition.mount)
                stops = self._continued(stops, _TARGET_TIGHTENING, SegmentLibrary(other))
        return stops

    def _continued(self, stops: Stops, factor: float, library: SegmentLibrary | None = None) -> Stops:
        """Return a schedule with more moves for targets times `factor`, by default under the planned conditions."""
        library = library or self._library
        problem = replace(self._problem(factor), library=library)
        seconds = durations(library, stops)[-1]
        before = stops, states(library, stops)[-1], seconds
        *_, (_, longer) = Beam(problem, _RESERVE_WIDTH, _MAX_DURATION_RATIO * seconds).run(before)
        return longer or stops

    def _best(self, duration: float) -> tuple[Stops, float]:
        """Return the schedule with the smallest worst ratio within a duration, s, and this ratio.

        Raises ConfigurationError if the effects of the product's diagnosis need more time.
        """
        factor, worst = _UNREACHABLE_FACTOR, np.inf
        best: Stops = ()
        for step in range(_STEPS):
            # The first beam is narrow and not stopped early, because it contains long schedules only at its end.
            beam = Beam(self._problem(factor), _WIDTHS[min(step, 1)], duration, self._front)
            for seconds, _ in beam.run():
                self._report(_SEARCHED * (step + seconds / duration) / (2 * _STEPS), note=_ratio(worst))
                if step and self._should_stop():
                    break
            points = [point for point in self._front.points() if point[0] <= duration]
            if not points:
                raise ConfigurationError("design.too_short", seconds=duration)
            _, ratio, stops = min(points, key=lambda point: point[1])
            improved = ratio <= _TARGET_REDUCTION * worst
            if ratio < worst:
                worst, best = ratio, stops
            if not improved or self._should_stop():
                break
            factor = _TARGET_REDUCTION * worst
        for step in range(_STEPS):
            exchange = Exchange(self._problem(_TARGET_REDUCTION * worst), best, self._request.seed)
            for share in exchange.run(_EXCHANGES // 3):
                self._report(_SEARCHED * (0.5 + (step + share) / (2 * _STEPS)), note=_ratio(worst))
                if self._should_stop():
                    break
            if not exchange.reached:
                break
            best, worst = exchange.best, _TARGET_REDUCTION * worst
            self._front.add(exchange.time, worst, best)
        return best, worst


def _ratio(worst: float) -> str:
    """Return a ratio as text for the progress; empty if there is no ratio yet."""
    return f"{worst:.3f}" if np.isfinite(worst) else ""


def _moves(stops: Stops) -> tuple[tuple[float, float, float], ...]:
    return tuple((s.position[0] * LATTICE_DEG, s.position[1] * LATTICE_DEG, s.rest * REST_UNIT) for s in stops)
