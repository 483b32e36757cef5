"""Search for the shortest schedule that reaches target sigmas, by a beam search followed by exchanges of single moves.

Every node of the beam is a schedule that ends at a time and a position; among schedules that end at about the same
time, only the best are continued. Schedules are compared by the sum of the positive ln(sigma / target) over the
parameters. The exchanges then change, insert, remove or swap moves and rests (simulated annealing).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import cycle, pairwise

import numpy as np

from calstation.designer.segments import REST_UNIT, Position, SegmentLibrary
from calstation.estimation.effects import MAX_EXCESS
from calstation.estimation.navigation import precision
from calstation.physics import COUNT, FloatArray

#: Largest sum of the angles of both joints in a move, in units of the lattice.
_MAX_MOVE = 10
#: Additional rests tried by the beam, in units of `REST_UNIT`.
_RESTS = (1, 3, 8, 24, 60)
#: Largest number of times at which schedules are compared.
_TIMES = 400
#: The first rest, for alignment, in units of `REST_UNIT`.
FIRST_REST = 12
#: Number of moves of the random walk that determines which targets are reachable, and its longest duration, s.
_WALK, _MAX_WALK_DURATION = 30, 3600.0
#: Rests of the walks, in units of `REST_UNIT`. Long rests favour the accelerometers, and many moves the gyros. Every
#: walk is also tried with turns by multiples of 90° only, which favour the scale factors.
_WALK_RESTS = ((2, 10, 40), (40, 60), (120,))
#: Size of an effect, in its sigmas, at which its test is expected to fail.
DETECTION = float(np.sqrt(MAX_EXCESS + 1.0))
#: Number of schedules evaluated per exchange step.
_BATCH = 48


@dataclass(frozen=True)
class Stop:
    """A position and the rest at it, in units of `REST_UNIT`."""

    position: Position
    rest: int


Stops = tuple[Stop, ...]


@dataclass(frozen=True)
class Problem:
    """Moves permitted by a table, and the target sigmas."""

    library: SegmentLibrary
    targets: FloatArray  #: Targets of the sigmas, SI, shape (30,); infinite for parameters without a target.
    low: Position  #: Lowest angles of the joints.
    high: Position  #: Highest angles of the joints.
    turns: tuple[int, ...]  #: Angles by which a joint turns in a move.
    margin: float = 1.0  #: Ratio of targets to limits.
    long_rest: int = 0  #: Length of the required long rests, in units of `REST_UNIT`.
    long_rests: int = 0  #: Number of required long rests.
    #: Sizes of the effects that must be detected, SI, shape (k,); infinite for those without a required size.
    sizes: FloatArray = field(default_factory=lambda: np.zeros(0))
    #: Errors of parameters at which effects must be detected, SI, shape (30, k); infinite where none is required.
    errors: FloatArray = field(default_factory=lambda: np.zeros((COUNT, 0)))
    #: Sigmas at which parameters are determined, SI, by the index of the parameter.
    determined: Mapping[int, float] = field(default_factory=dict)

    def ratios(self, information: FloatArray) -> FloatArray:
        """Return the ratios of n schedules to their targets, shape (n, 30 + k + d), from their information.

        They are the ratios of sigmas to targets, of the detectable to the required size of each effect, and of the
        sigmas to those at which parameters are determined.
        """
        sigma, size_sigma, error = precision(information, self.library.states)
        required = np.maximum(1.0 / self.sizes, np.max(np.abs(error) / self.errors, axis=1))
        determined = sigma[:, [*self.determined]] / [*self.determined.values()]
        return np.hstack([sigma / self.targets, DETECTION * size_sigma * required, determined])

    def allowed(self, position: Position) -> bool:
        """Return whether a position is within the travel."""
        return all(a <= x <= b for a, x, b in zip(self.low, position, self.high, strict=True))

    def with_long_rests(self, stops: Stops) -> Stops:
        """Return a schedule whose longest rests are as long as required."""
        longest = sorted(range(len(stops)), key=lambda k: -stops[k].rest)[: self.long_rests]
        return tuple(
            Stop(stop.position, max(stop.rest, self.long_rest)) if k in longest else stop
            for k, stop in enumerate(stops)
        )

    def has_long_rests(self, stops: Sequence[Stop]) -> bool:
        """Return whether the schedule contains the required long rests."""
        return sum(stop.rest >= self.long_rest for stop in stops) >= self.long_rests

    def permits(self, stops: Sequence[Stop]) -> bool:
        """Return whether a schedule may contain the moves between these stops."""
        moves = [(a.position, b.position) for a, b in pairwise(stops)]
        sizes = [abs(b[0] - a[0]) + abs(b[1] - a[1]) for a, b in moves]
        return all(0 < size <= _MAX_MOVE for size in sizes) and all(self.allowed(b) for _, b in moves)

    def next_positions(self, position: Position) -> Iterator[Position]:
        """Yield the positions that a move can reach."""
        for outer in self.turns:
            for inner in self.turns:
                target = (position[0] + outer, position[1] + inner)
                if (outer or inner) and abs(outer) + abs(inner) <= _MAX_MOVE and self.allowed(target):
                    yield target


@dataclass(slots=True)
class _Node:
    """A schedule of the beam: its last stop and the preceding node."""

    information: FloatArray | None
    position: Position
    time: float
    remaining_log_ratio: float
    worst: float
    before: "_Node | None" = None
    rest: int = 1

    def stops(self) -> Stops:
        """Return the schedule."""
        stops: list[Stop] = []
        node: _Node | None = self
        while node is not None:
            if stops and stops[-1].position == node.position:
                stops[-1] = Stop(node.position, stops[-1].rest + node.rest)
            else:
                stops.append(Stop(node.position, node.rest))
            node = node.before
        return tuple(reversed(stops))


@dataclass
class Front:
    """Pareto front: the smallest worst ratio of a sigma to its limit for each duration, and its schedule."""

    _best: dict[int, tuple[float, float, Stops]] = field(default_factory=dict)

    def add(self, time: float, worst: float, stops: Stops) -> None:
        """Add a schedule."""
        key = round(time)
        if key not in self._best or worst < self._best[key][1]:
            self._best[key] = (time, worst, stops)

    def points(self) -> list[tuple[float, float, Stops]]:
        """Return the durations, s, the ratios and the schedules of the front."""
        points: list[tuple[float, float, Stops]] = []
        for key in sorted(self._best):
            if not points or self._best[key][1] < points[-1][1]:
                points.append(self._best[key])
        return points


def remaining_log_ratio(ratios: FloatArray) -> FloatArray:
    """Sum the positive logarithms of ratios of sigmas to targets, shape (n, c); return an array of shape (n,)."""
    return np.asarray(np.log(np.maximum(ratios, 1.0)).sum(axis=1))


class Beam:
    """Beam search from a first rest, or from the end of another schedule.

    Parameters
    ----------
    problem : permitted moves and target sigmas
    width : largest number of schedules that are continued at each time
    longest : longest duration, s
    front : Pareto front to which results are added
    """

    def __init__(self, problem: Problem, width: int, longest: float, front: Front | None = None) -> None:
        self._problem, self._width, self._longest, self._front = problem, width, longest, front
        self._interval = max(REST_UNIT, longest / _TIMES)
        self._queue: dict[int, list[_Node]] = {}
        self._first_stops: Stops = (Stop((0, 0), FIRST_REST),)

    def run(self, before: tuple[Stops, FloatArray, float] | None = None) -> Iterator[tuple[float, Stops | None]]:
        """Yield the time reached, s, with None, and finally the time and the stops of the result, or None.

        `before` contains the stops to continue, the information after them, and their duration, s.
        """
        if before is None:
            state = self._problem.library.begin((0, 0), FIRST_REST)
            time = durations(self._problem.library, self._first_stops)[0]
        else:
            self._first_stops, state, time = before
        first = _Node(state, self._first_stops[-1].position, time, np.inf, np.inf)
        self._queue = {self._key(time): [first]}
        at = self._key(time)
        while self._queue:
            nodes = self._best(self._queue.pop(at, []))
            if nodes and nodes[0].remaining_log_ratio <= 0.0:
                yield nodes[0].time, self._complete(nodes[0])
                return
            at += 1
            self._extend(nodes, at)
            yield at * self._interval, None
        yield self._longest, None

    def _key(self, time: float) -> int:
        return int(np.ceil(time / self._interval - 1e-9))

    def _best(self, nodes: list[_Node]) -> list[_Node]:
        """Return the best nodes of a time, without duplicates."""
        nodes.sort(key=lambda node: (node.remaining_log_ratio, node.time))
        best_nodes: list[_Node] = []
        keys: set[tuple[int, int, float]] = set()
        for node in nodes:
            key = (node.position[0] % 8, node.position[1] % 8, round(node.remaining_log_ratio, 3))
            if key not in keys:
                keys.add(key)
                best_nodes.append(node)
            if len(best_nodes) == self._width:
                break
        best = min(best_nodes, key=lambda node: node.worst, default=None)
        if self._front is not None and best is not None and np.isfinite(best.worst):
            self._front.add(best.time, self._problem.margin * best.worst, self._complete(best))
        return best_nodes

    def _complete(self, node: _Node) -> Stops:
        """Return the schedule of a node, including the stops before the first node."""
        *before, last = self._first_stops
        first, *others = node.stops()
        return (*before, Stop(last.position, last.rest + first.rest - 1), *others)

    def _extend(self, nodes: list[_Node], earliest: int) -> None:
        library = self._problem.library
        before: list[_Node] = []
        segments: list[FloatArray] = []
        durations_s: list[float] = []
        after: list[tuple[Position, float, int]] = []
        for node in nodes:
            for to in self._problem.next_positions(node.position):
                segment, seconds = library.move(node.position, to)
                if node.time + seconds <= self._longest:
                    before.append(node)
                    segments.append(segment)
                    durations_s.append(seconds)
                    after.append((to, node.time + seconds, 1))
            for rest in _RESTS:
                time = node.time + rest * REST_UNIT
                if time <= self._longest:
                    before.append(node)
                    segments.append(library.rest(node.position, rest))
                    durations_s.append(rest * REST_UNIT)
                    after.append((node.position, time, rest))
        if not before:
            return
        starts = np.array([node.information for node in before])
        states = library.advance(starts, np.array(segments), np.array(durations_s))
        ratios = self._problem.ratios(states)
        remaining = remaining_log_ratio(ratios)
        # A schedule that does not detect all effects and determine all parameters is not a point of the front.
        sufficient = np.all(ratios[:, COUNT:] <= 1.0, axis=1)
        worst = np.where(sufficient, ratios[:, :COUNT].max(axis=1), np.inf)
        for node in nodes:
            node.information = None
        for k, (to, time, rest) in enumerate(after):
            node = _Node(states[k], to, time, float(remaining[k]), float(worst[k]), before[k], rest)
            self._queue.setdefault(max(self._key(time), earliest), []).append(node)
        for key, queued in self._queue.items():
            if len(queued) > 8 * self._width:
                queued.sort(key=lambda node: node.remaining_log_ratio)
                self._queue[key] = queued[: 4 * self._width]
        for queued in self._queue.values():
            for node in queued:
                if node.information is not None and node.information.base is not None:
                    # a view would keep the information of all other schedules in memory
                    node.information = node.information.copy()


def shortest_walk(problem: Problem, seed: int) -> tuple[Stops | None, FloatArray]:
    """Return the shortest random walk that reaches all targets within an hour, and the ratios after it, shape (c,).

    If no walk reaches them, return None and the ratios after the closest walk.
    """
    faces = replace(problem, turns=tuple(turn for turn in problem.turns if turn % 2 == 0))
    possible = [each for each in (problem, faces) if any(each.next_positions((0, 0)))]
    walks = [_walk(each, rests, seed) for each in possible for rests in _WALK_RESTS]
    successful = [walk for walk in walks if walk[1].max() <= 1.0]
    if successful:
        return min(successful, key=lambda walk: durations(problem.library, walk[0])[-1])
    return None, min((ratios for _, ratios in walks), key=lambda ratios: float(ratios.max()))


def _walk(problem: Problem, pattern: Sequence[int], seed: int) -> tuple[Stops, FloatArray]:
    """Return a random walk with a pattern of rests, and the ratios after it.

    The walk is repeated until all targets are reached or an hour has passed.
    """
    rng, library = np.random.default_rng(seed), problem.library
    positions = [(0, 0)]
    for _ in range(_WALK):
        targets = list(problem.next_positions(positions[-1]))
        positions.append(targets[int(rng.integers(len(targets)))])
    home = [to for to in ((0, positions[-1][1]), (0, 0)) if to != positions[-1]]
    if len(home) == 2 and home[0] == home[1]:
        del home[0]
    rests = cycle(pattern)
    loop = tuple(Stop(position, next(rests)) for position in [*positions[1:], *home])
    first = Stop((0, 0), FIRST_REST)
    state = library.begin(first.position, first.rest)
    parts = [
        part
        for a, b in pairwise((first, *loop))
        for part in (
            library.move(a.position, b.position),
            (library.rest(b.position, b.rest - 1), (b.rest - 1) * REST_UNIT),
        )
    ]
    segment, seconds = reduce(lambda a, b: (library.join(a[0], b[0], b[1]), a[1] + b[1]), parts)
    repetitions = 1
    while True:
        ratios = problem.ratios(library.advance(state[None], segment[None], repetitions * seconds))[0]
        if ratios.max() <= 1.0 or repetitions * seconds > _MAX_WALK_DURATION:
            return (first, *(repetitions * loop)), ratios
        segment = library.join(segment, segment, repetitions * seconds)
        repetitions *= 2


def durations(library: SegmentLibrary, stops: Stops) -> list[float]:
    """Return the time at the end of every stop, s."""
    times = [library.settle + stops[0].rest * REST_UNIT]
    for a, b in pairwise(stops):
        times.append(times[-1] + library.move(a.position, b.position)[1] + (b.rest - 1) * REST_UNIT)
    return times


def states(library: SegmentLibrary, stops: Stops) -> list[FloatArray]:
    """Return the information at the end of every stop."""
    ends = [library.begin(stops[0].position, stops[0].rest)]
    for a, b in pairwise(stops):
        segment, seconds = library.move(a.position, b.position)
        state = library.advance(ends[-1][None], segment[None], seconds)
        if b.rest > 1:
            rest = library.rest(b.position, b.rest - 1)
            state = library.advance(state, rest[None], (b.rest - 1) * REST_UNIT)
        ends.append(state[0])
    return ends


class Exchange:
    """Improves a schedule by changes of single moves and rests; deterministic for a seed.

    Parameters
    ----------
    problem : permitted moves and target sigmas
    stops : the schedule
    seed : seed of the random changes
    longest : longest duration of the result, s, if the schedule does not reach all targets; None for its duration
    """

    def __init__(self, problem: Problem, stops: Stops, seed: int, longest: float | None = None) -> None:
        self._problem, self._rng = problem, np.random.default_rng(seed)
        self._library = problem.library
        self._set_stops(stops)
        self.best, self.time = stops, self._times[-1]
        #: Whether `best` reaches all targets.
        self.reached = bool(remaining_log_ratio(problem.ratios(self._states[-1][None]))[0] <= 0.0)
        if not self.reached and longest is not None:
            self.time = longest

    def _set_stops(self, stops: Stops) -> None:
        self._stops = stops
        self._states, self._times = states(self._library, stops), durations(self._library, stops)

    def run(self, steps: int) -> Iterator[float]:
        """Execute the exchange steps and yield the completed fraction; `best` and `time` are the best result so far."""
        problem, rng = self._problem, self._rng
        if len(self._stops) < 2:
            return
        start = self._times[-1]
        price = 2.0 * start  # penalty for targets that are not reached, s
        cost = start + price * float(remaining_log_ratio(problem.ratios(self._states[-1][None]))[0])
        for step in range(steps):
            heat = 0.01 * start * (1.0 - step / steps) ** 2
            cut = int(rng.integers(1, len(self._stops)))
            candidates = [t for t in (self._random_change(cut) for _ in range(_BATCH)) if t is not None]
            yield (step + 1) / steps
            if not candidates:
                continue
            ends, times = self._ends(cut, candidates)
            remaining = remaining_log_ratio(problem.ratios(ends))
            costs = times + price * remaining
            best_candidate = int(np.argmin(costs))
            improved = np.flatnonzero((remaining <= 0.0) & (times < self.time + (-1e-9 if self.reached else 1e-9)))
            if len(improved):
                self.reached = True
                first = int(improved[np.argmin(times[improved])])
                self.best, self.time = candidates[first], float(times[first])
            if costs[best_candidate] < cost + heat * rng.exponential():
                cost = float(costs[best_candidate])
                self._set_stops(candidates[best_candidate])

    def _random_change(self, cut: int) -> Stops | None:
        """Return the schedule with a random change at or after stop `cut`, or None if the table cannot execute it."""
        rng, stops = self._rng, list(self._stops)
        k = cut + int(rng.integers(0, min(3, len(stops) - cut)))
        kind = int(rng.integers(0, 6))
        if kind == 0:
            stops[k] = Stop(self._random_position(stops[k - 1].position), stops[k].rest)
        elif kind == 1:
            change = int(rng.choice([-8, -4, -2, -1, 1, 2, 4, 8]))
            stops[k] = Stop(stops[k].position, max(stops[k].rest + change, 1))
        elif kind == 2:
            stops.insert(k, Stop(self._random_position(stops[k - 1].position), int(rng.integers(1, 4))))
        elif kind == 3 and len(stops) > 2:
            del stops[k]
        elif kind == 4 and k + 1 < len(stops):
            stops[k], stops[k + 1] = stops[k + 1], stops[k]
        else:  # all later stops are shifted by the same angles
            target = self._random_position(stops[k - 1].position)
            shift = target[0] - stops[k].position[0], target[1] - stops[k].position[1]
            stops[k:] = [Stop((s.position[0] + shift[0], s.position[1] + shift[1]), s.rest) for s in stops[k:]]
        permitted = self._problem.permits(stops[cut - 1 :]) and self._problem.has_long_rests(stops)
        return tuple(stops) if permitted else None

    def _random_position(self, at: Position) -> Position:
        targets = list(self._problem.next_positions(at))
        return targets[int(self._rng.integers(len(targets)))]

    def _ends(self, cut: int, candidates: Sequence[Stops]) -> tuple[FloatArray, FloatArray]:
        """Return the information at the ends of schedules with equal stops before `cut`, and their durations, s."""
        library = self._library
        state = np.repeat(self._states[cut - 1][None], len(candidates), axis=0)
        times = np.full(len(candidates), self._times[cut - 1])
        for k in range(cut, max(len(stops) for stops in candidates)):
            active = [i for i, stops in enumerate(candidates) if k < len(stops)]
            moves = [library.move(candidates[i][k - 1].position, candidates[i][k].position) for i in active]
            seconds = np.array([seconds for _, seconds in moves])
            state[active] = library.advance(state[active], np.array([segment for segment, _ in moves]), seconds)
            times[active] += seconds
            longer = [i for i in active if candidates[i][k].rest > 1]
            if longer:
                rests = [library.rest(candidates[i][k].position, candidates[i][k].rest - 1) for i in longer]
                seconds = np.array([(candidates[i][k].rest - 1) * REST_UNIT for i in longer])
                state[longer] = library.advance(state[longer], np.array(rests), seconds)
                times[longer] += seconds
        return state, times
