"""Simulation of a plan from the true values without any protocol, for the Monte Carlo study."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from calstation.bench.truth.drive import EncoderTruth, TableDrive
from calstation.bench.truth.grades import GradeName
from calstation.bench.truth.imu import ImuTruth, SensorStream
from calstation.bench.truth.table import TableTruth
from calstation.bench.truth.thermal import UnitThermal
from calstation.physics import Dwell, FloatArray, IntArray, Move, RoundEnd, Step

#: Time between encoder readings, s.
POLL_INTERVAL = 0.05
#: Temperature of the unit without a chamber, °C.
TEMPERATURE = 25.0

#: Counts, encoder angles and step numbers of consecutive samples.
Samples = tuple[FloatArray, FloatArray, IntArray]


@dataclass(frozen=True)
class BenchTruth:
    """True values of all quantities that the station estimates.

    `azimuth` is the value in the station file, rad; the true azimuth is `table.azimuth`. `outer_lever` is "estimated",
    or "fixed" at 0.
    """

    imu: ImuTruth
    table: TableTruth
    encoder: EncoderTruth
    grade: GradeName
    azimuth: float
    outer_lever: str

    @property
    def parameters(self) -> FloatArray:
        """The 30 true parameters in the order of `physics.parameters`, SI, shape (30,)."""
        return self.imu.parameters


@dataclass(frozen=True)
class Simulated:
    """Samples of one stage, with the timestamps of an ideal acquisition.

    `time` is the end of each sample by the unit's clock, s. `angles` are the encoder angles at these times, rad, NaN
    between polls, shape (n, 2). `step` is the number of previous moves.
    """

    stage: str
    seq: IntArray
    time: FloatArray
    counts: FloatArray
    angles: FloatArray
    step: IntArray
    temperature: FloatArray


class Simulator:
    """Simulates consecutive stages on one bench; each stage continues from the final state of the previous one.

    Equal seeds and plans result in equal samples.
    """

    def __init__(
        self,
        truth: BenchTruth,
        seed: int | np.random.SeedSequence,
        *,
        thermal: UnitThermal | None = None,
        air: Callable[[], float] = lambda: TEMPERATURE,
    ) -> None:
        root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
        stream_seed, encoder_seed = root.spawn(2)
        self._stream = SensorStream(truth.imu, truth.table, stream_seed, thermal=thermal, air=air)
        self._drive = TableDrive(truth.encoder, seed=encoder_seed)
        self._nominal = 1.0 / truth.imu.sample_rate
        self._poll_every = max(1, round(POLL_INTERVAL * truth.imu.sample_rate))
        self._step = 0

    @property
    def time(self) -> float:
        """End of the last sample, s."""
        return self._stream.time

    @property
    def parameters(self) -> FloatArray:
        """The unit's 30 parameters at the end of the last sample, SI, shape (30,)."""
        return self._stream.parameters

    def run(self, steps: Iterable[Step], stage: str, rounds: int | None = None) -> Simulated:
        """Simulate one stage; `rounds` limits an endless plan.

        A move ends when both joints have settled, and a dwell after its duration; other steps take no time.
        """
        parts: list[Samples] = []
        first = self._stream.produced
        for step in steps:
            if isinstance(step, Move):
                self._step += 1
                self._drive.move(
                    self.time, (step.outer, step.inner), (step.rate, step.rate), (step.acceleration, step.acceleration)
                )
                parts.append(self._produce(max(self._drive.settled - self.time, 0.0)))
            elif isinstance(step, Dwell):
                parts.append(self._produce(step.duration))
            elif isinstance(step, RoundEnd) and rounds is not None and step.rounds >= rounds:
                break
            else:
                parts += self._further(step)
        seq = np.arange(first, self._stream.produced)
        if not parts:
            parts.append(self._produce(0.0))
        counts, angles, numbers = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Simulated(
            stage,
            seq,
            np.asarray((seq + 1) * self._nominal, np.float64),
            counts,
            angles,
            numbers,
            self._temperatures(seq),
        )

    def _further(self, step: Step) -> Iterable[Samples]:
        """Return the samples of a step of another kind, which takes no time."""
        return ()

    def _temperatures(self, seq: IntArray) -> FloatArray:
        """Return the temperature that the unit measures at its samples, °C."""
        return np.full(len(seq), TEMPERATURE)

    def _ends(self, seq: IntArray) -> FloatArray:
        return np.asarray((seq + 1) * self._stream.interval, dtype=np.float64)

    def _produce(self, duration: float) -> Samples:
        """Return counts, encoder angles and step numbers of the samples in the next `duration`, s."""
        count = int(np.ceil(duration / self._stream.interval - 1e-9))
        first = self._stream.produced
        outer, inner = self._drive.profiles
        counts = self._stream.produce(count, outer, inner).counts
        angles = np.full((count, 2), np.nan)
        polled = np.flatnonzero((np.arange(first, first + count) + 1) % self._poll_every == 0)
        angles[polled] = self._drive.readings(self._ends(first + polled))
        return counts, angles, np.full(count, self._step, dtype=np.int64)
