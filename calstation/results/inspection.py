"""Inspection of a recording: its contents, sample rate and gaps, and the methods that can solve it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock, has_gyros, join_blocks
from calstation.judgement import data_faults
from calstation.messages import Text
from calstation.records import Log, LogFacts, context_from_meta, open_log, prior_from_meta
from calstation.results.solver_chain import solve
from procedures import method, names


@dataclass(frozen=True)
class Inspection:
    """Contents of a recording."""

    serial: str
    facts: LogFacts
    rate: float  #: Sample rate from its clock, or from a line fitted to the arrival times, Hz; NaN for one sample.
    configured_rate: float  #: Sample rate of its configuration, Hz.
    #: Root mean square deviation of the arrival times from the sample clock, s; 0 if the recording has a clock.
    jitter: float
    missing: int  #: Number of samples missing in gaps.
    invalid: int  #: Number of invalid samples.
    channels: tuple[str, ...]  #: Groups of columns: gyro, accel, encoders, temperature, imu2, ..., joints.
    stages: dict[str, int]  #: Number of samples of each recorded stage, in order.
    methods: dict[str, Text | None]  #: Reason why a method cannot solve it, None if it can.
    #: Errors of the samples, and of the configuration, that the stages reveal.
    faults: tuple[Text, ...] = ()


def inspect_recording(path: Path) -> Inspection:
    """Read a log or a CSV and solve its stages, or solve it with the methods that need no table if it has no stages.

    Raises InputError if it cannot be read.
    """
    log = open_log(path)
    stages: dict[str, int] = {}
    invalid, channels = 0, dict.fromkeys(["accel"])
    seq, time = [], []
    for block in log.blocks():
        seq.append(block.seq)
        time.append(block.time)
        invalid += int(np.count_nonzero(~block.valid))
        if block.stage:
            stages[block.stage] = stages.get(block.stage, 0) + len(block)
        present = {
            "gyro": has_gyros(block.counts),
            "encoders": not np.isnan(block.angles).all(),
            "joints": bool(block.joints.size) and not np.isnan(block.joints).all(),
            "temperature": not np.isnan(block.temperature).all(),
        }
        channels |= dict.fromkeys(name for name, is_present in present.items() if is_present)
    channels |= dict.fromkeys(f"imu{number}" for number in log.meta.secondaries)
    counter, clock = np.concatenate(seq), np.concatenate(time)
    line = np.polynomial.Polynomial.fit(counter, clock, 1).convert().coef if len(clock) > 1 else [0.0, np.nan]
    facts = log.facts()
    return Inspection(
        serial=log.meta.imu.serial,
        facts=facts,
        rate=float(1.0 / line[1]),
        configured_rate=log.meta.imu.sample_rate_hz,
        jitter=log.jitter,
        missing=facts.last_seq - facts.first_seq + 1 - facts.samples,
        invalid=invalid,
        channels=tuple(sorted(channels)),
        stages=stages,
        methods=_recorded(log, stages) if stages else {n: _reason(log, n) for n in names() if method(n).needs_no_table},
        faults=recording_faults(log),
    )


def recording_faults(log: Log) -> tuple[Text, ...]:
    """Return the errors of the samples, and of the configuration, that the stages of a log reveal without a solution.

    Raises InputError if the log cannot be read.
    """
    context, prior = context_from_meta(log.meta), prior_from_meta(log.meta)
    by_stage: dict[str, list[SampleBlock]] = {}
    for block in log.blocks():
        by_stage.setdefault(block.stage, []).append(block)
    faults: list[Text] = []
    for stage, blocks in by_stage.items():
        if stage:
            found = data_faults(join_blocks(blocks), context, prior)
            faults += [Text.of("solution.in_stage", stage=stage, what=fault.text(stage)) for fault in found]
        elif len(by_stage) == 1:  # a recording without stages
            faults += [fault.text(stage) for fault in data_faults(join_blocks(blocks), context, prior)]
    return tuple(faults)


def _recorded(log: Log, stages: dict[str, int]) -> dict[str, Text | None]:
    """Solve the stages in order, each with the posterior of the preceding ones."""
    try:
        missing = solve(log.blocks, log.meta, source=log.path).missing_data
    except InputError as exc:
        return dict.fromkeys(stages, exc.as_text)
    return {stage: missing.get(stage) for stage in stages}


def _reason(log: Log, name: str) -> Text | None:
    """Return why a method cannot solve the whole recording; None if it can."""
    try:
        solve(log.blocks, log.meta, (name,), source=log.path)
    except InputError as exc:
        return exc.as_text
    return None
