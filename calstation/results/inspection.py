"""Inspection of a recording: its contents, sample rate and gaps, and the methods that can solve it."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock, has_gyros, join_blocks
from calstation.jobs import ProgressCallback
from calstation.judgement import data_faults
from calstation.messages import Text
from calstation.records import Log, LogFacts, UnusedSamples, context_from_meta, open_log, prior_from_meta
from calstation.results.solver_chain import solve
from procedures import method, names

#: Largest number of samples of each stage, or of a recording without stages, that are tested and solved: 83 minutes at
#: 200 Hz in about 0.6 GB. Further samples are only counted.
MAX_TESTED = 1_000_000
#: Codes of the messages about wrong physical units, which contradict gravity or the table.
_UNIT_ERRORS = {"recording.accel_unit", "recording.gyro_unit", "recording.gyro_unit_no_rest"}
_UNIT_ERRORS |= {"cause.accel_unit", "cause.gyro_unit"}


@dataclass(frozen=True)
class Inspection:
    """Contents of a recording."""

    serial: str
    facts: LogFacts
    #: Sample rate from the recorded times, or from a line fitted to the arrival times, Hz; NaN for one sample.
    rate: float
    configured_rate: float  #: Sample rate of its configuration, Hz.
    #: Root mean square deviation of the arrival times from the sample clock, s; 0 if the recording has a clock.
    jitter: float
    missing: int  #: Number of samples missing in gaps.
    invalid: int  #: Number of invalid samples.
    paused: int  #: Number of samples in pauses, which are valid but not used.
    channels: tuple[str, ...]  #: Groups of columns: gyro, accel, encoders, temperature, imu2, ..., joints.
    stages: dict[str, int]  #: Number of samples of each recorded stage, in order.
    methods: dict[str, Text | None]  #: Reason why each method cannot solve the recording; None if it can.
    #: Errors of the samples and of the configuration, found in the data of the stages.
    faults: tuple[Text, ...] = ()
    columns: Mapping[str, str] = field(default_factory=dict)  #: As `Log.columns`.
    unused: tuple[str, ...] = ()  #: As `Log.unused`.
    irregular_times: tuple[Text, ...] = ()  #: Irregularities of the time stamps.
    #: Number of samples at the start of every longer stage, or of the recording, on which `methods` and `faults` are
    #: based; None for all samples.
    tested: int | None = None

    @property
    def unit_error(self) -> Text | None:
        """The message about wrong physical units; None if there is none."""
        texts = (*self.faults, *filter(None, self.methods.values()))
        return next((part for text in texts for part in _parts(text) if part.code in _UNIT_ERRORS), None)

    @property
    def summary(self) -> list[tuple[str, Text]]:
        """The contents as rows: code of the name ("" to continue the preceding row) and text."""
        facts, text = self.facts, Text.of
        seconds = (facts.last_seq - facts.first_seq + 1) / self.configured_rate
        samples = {"samples": facts.samples, "first_seq": facts.first_seq, "last_seq": facts.last_seq}
        times = text("look.arrival_times", jitter=1e3 * self.jitter) if self.jitter else Text("look.sample_clock")
        stages = ", ".join(f"{stage} ({count})" for stage, count in self.stages.items()) or Text("look.no_stages")
        invalid = "look.damaged_are" if facts.damaged else "look.invalid_are"
        return [
            ("look.unit", text("look.unit_is", serial=self.serial)),
            *(("look.fault", text("look.fault_is", fault=fault)) for fault in self.faults),
            ("look.samples", text("look.samples_are", **samples, seconds=seconds)),
            ("look.rate", text("look.rate_is", rate=self.rate, configured=self.configured_rate, times=times)),
            ("look.gaps", text("look.gaps_are", gaps=facts.gaps, missing=self.missing)),
            ("look.invalid", text(invalid, invalid=self.invalid, damaged=facts.damaged)),
            *([("look.paused", text("look.paused_are", paused=self.paused))] if self.paused else []),
            *(("look.times", irregular) for irregular in self.irregular_times),
            ("look.channels", text("look.channels_are", channels=list(self.channels))),
            *(("", text("look.column_is", name=name, source=source)) for name, source in self.columns.items()),
            *([("", text("look.not_used", names=list(self.unused)))] if self.unused else []),
            ("look.stages", text("look.stages_are", stages=stages)),
            *([("look.tested", text("look.tested_are", samples=self.tested))] if self.tested is not None else []),
        ]


def _parts(text: Text) -> Iterator[Text]:
    """Yield a message and the messages that it contains."""
    yield text
    for value in text.values.values():
        if isinstance(value, Text):
            yield from _parts(value)


def inspect_recording(path: Path) -> Inspection:
    """Open a log of any format and inspect it. Raises InputError if it cannot be read."""
    return inspect_log(open_log(path))


def look_at(report: ProgressCallback, path: Path, meta_file: Path | None, topic: str | None) -> Inspection:
    """Job: inspect a recording, see `records.open_log`. Raises InputError if it cannot be read."""
    inspection = inspect_log(open_log(path, meta_file, topic))
    report(1.0)
    return inspection


def inspect_log(log: Log) -> Inspection:
    """Read a log and solve its stages, or solve it with the methods that need no table if it has no stages.

    Raises InputError if it cannot be read.
    """
    counted = Counter[str]()
    unused, channels, clock = UnusedSamples(log.events, log.meta), dict.fromkeys(["accel"]), _ClockFit()
    for block in log.blocks():
        clock.add(block)
        unused.add(block)
        counted[block.stage] += len(block)
        present = {
            "gyro": has_gyros(block.counts),
            "encoders": not np.isnan(block.angles).all(),
            "joints": bool(block.joints.size) and not np.isnan(block.joints).all(),
            "temperature": not np.isnan(block.temperature).all(),
        }
        channels |= dict.fromkeys(name for name, is_present in present.items() if is_present)
    channels |= dict.fromkeys(f"imu{number}" for number in log.meta.secondaries)
    unused.close()
    stages = {stage: count for stage, count in counted.items() if stage}
    facts = log.facts()
    return Inspection(
        serial=log.meta.imu.serial,
        facts=facts,
        rate=clock.rate,
        configured_rate=log.meta.imu.sample_rate_hz,
        jitter=log.times.jitter,
        missing=facts.last_seq - facts.first_seq + 1 - facts.samples,
        invalid=unused.invalid,
        paused=unused.paused,
        channels=tuple(sorted(channels)),
        stages=stages,
        methods=_recorded(log, stages) if stages else {n: _reason(log, n) for n in names() if method(n).needs_no_table},
        faults=recording_faults(log),
        columns=log.columns,
        unused=log.unused,
        irregular_times=tuple(log.times.irregularities),
        tested=MAX_TESTED if max((stages or counted).values()) > MAX_TESTED else None,
    )


class _ClockFit:
    """Fits a line to the times of all samples, without storing them."""

    def __init__(self) -> None:
        self._first: tuple[int, float] | None = None
        self._sums = np.zeros(5)

    def add(self, block: SampleBlock) -> None:
        """Add the next samples."""
        self._first = self._first or (int(block.seq[0]), float(block.time[0]))
        x, y = (block.seq - self._first[0]).astype(np.float64), block.time - self._first[1]
        self._sums += [len(x), float(x.sum()), float(y.sum()), float(x @ x), float(x @ y)]

    @property
    def rate(self) -> float:
        """Sample rate, Hz; NaN for one sample."""
        n, x, y, xx, xy = self._sums.tolist()
        return (xx - x * x / n) / (xy - x * y / n) if n > 1 else np.nan


def recording_faults(log: Log) -> tuple[Text, ...]:
    """Return the errors of samples and configuration that the data of a log's stages show without a solution.

    Only the first `MAX_TESTED` samples of each stage are tested. Raises InputError if the log cannot be read.
    """
    context, prior = context_from_meta(log.meta), prior_from_meta(log.meta)
    faults: list[Text] = []
    for stage, blocks in _by_stage(log):
        texts = [fault.text(stage) for fault in data_faults(join_blocks(blocks), context, prior)]
        faults += [Text.of("solution.in_stage", stage=stage, what=text) if stage else text for text in texts]
    return tuple(faults)


def _first_samples(log: Log) -> Iterator[SampleBlock]:
    """Yield at most the first `MAX_TESTED` samples of each stage."""
    used = Counter[str]()
    for block in log.blocks():
        first = block.part(0, max(MAX_TESTED - used[block.stage], 0))
        used[block.stage] += len(first)
        if len(first):
            yield first


def _by_stage(log: Log) -> Iterator[tuple[str, list[SampleBlock]]]:
    """Yield the first samples of each stage, or of a recording without stages, whose name is ""."""
    current, blocks = "", list[SampleBlock]()
    for block in _first_samples(log):
        if block.stage and block.stage != current:
            if current:
                yield current, blocks
            current, blocks = block.stage, []
        if block.stage == current:
            blocks.append(block)
    yield current, blocks


def _recorded(log: Log, stages: dict[str, int]) -> dict[str, Text | None]:
    """Solve the stages in order; return the reason why each stage could not be solved, or None."""
    try:
        missing = solve(partial(_first_samples, log), log.meta, source=log.path).missing_data
    except InputError as exc:
        return dict.fromkeys(stages, exc.as_text)
    return {stage: missing.get(stage) for stage in stages}


def _reason(log: Log, name: str) -> Text | None:
    """Return why a method cannot solve the whole recording; None if it can."""
    try:
        solve(partial(_first_samples, log), log.meta, (name,), source=log.path)
    except InputError as exc:
        return exc.as_text
    return None
