"""Analysis of the samples of a log for its certificate: budget, convergence of the sigmas, and residuals at rest."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from calstation.errors import InputError
from calstation.estimation.common import RestResiduals, SampleBlock
from calstation.jobs import ProgressCallback
from calstation.judgement import judge
from calstation.messages import Text, entry, event_text, known, values_from_json
from calstation.physics import FloatArray
from calstation.records import Log, LogMeta, UnusedSamples, completed_rounds
from calstation.reports.budget import Budget, solve_again, uncertainty_budget
from calstation.reports.source import ROUNDING
from calstation.results import (
    Parameter,
    Result,
    StageChain,
    Temperature,
    one_blas_thread,
    solved_parameters,
    stage_diagnostics,
    with_states,
)

#: Progress of the job, as a fraction, after the first solution and after the residuals.
_SOLVED, _RESIDUALS = 0.2, 0.25


@dataclass(frozen=True)
class Analysis:
    """Results of the analysis of the samples of a log."""

    time: FloatArray  #: Time of each point since the first sample, s, shape (m,).
    sigma: FloatArray  #: Standard deviations of the 30 parameters at these points, SI, shape (m, 30).
    spans: Mapping[str, tuple[float, float]]  #: Start and end of the samples of every stage, s.
    rests: Mapping[str, RestResiduals]  #: Residuals at the rests of every stage.
    before: FloatArray  #: Standard deviations of the 30 parameters before the first stage, SI, shape (30,).
    after: FloatArray  #: Standard deviations of the 30 parameters after the last stage, SI, shape (30,).
    budget: Budget
    effects_tested: bool  #: Whether the data were tested for effects outside the error model.
    invalid: int  #: Number of samples outside pauses that were marked invalid.
    #: Temperature of the unit in the valid samples of the solved stages; None if unknown.
    temperature: Temperature | None
    warnings: tuple[Text, ...]  #: Warnings during the run, from the events of the log.
    identified: Mapping[str, str]  #: Names and serial numbers reported by the table and the IMU; empty if unknown.
    #: Number of completed rounds of every stage whose motion ended after one, from the events of the log.
    rounds: Mapping[str, int] = field(default_factory=dict)


class _SigmaRecorder:
    """Records the sigmas of a solver chain while samples are fed to it."""

    def __init__(self, log: Log, meta: LogMeta, result: Result) -> None:
        self.chain = StageChain(meta)
        self._rate, self._first = meta.imu.sample_rate_hz, result.log.first_seq
        self._length = max(result.log.last_seq - self._first, 1)
        self.time: list[float] = []
        self.sigma: list[FloatArray] = []
        self.spans: dict[str, tuple[float, float]] = {}
        self._stages, self._last_seq = result.stages, -1
        #: Number, sum, minimum and maximum of the temperatures of each block, by whether its stage was solved.
        self._temperatures: dict[bool, list[tuple[float, ...]]] = {True: [], False: []}
        self.unused = UnusedSamples(log.events, log.meta)

    def observe(self, block: SampleBlock) -> None:
        if not len(block) or block.seq[0] <= self._last_seq:  # a manual recording is read twice
            return
        self._last_seq = int(block.seq[-1])
        self.unused.add(block)
        values = block.temperature[block.valid & ~np.isnan(block.temperature)]
        if len(values):
            row = len(values), float(values.sum()), float(values.min()), float(values.max())
            self._temperatures[block.stage in self._stages].append(row)

    def temperature(self) -> Temperature | None:
        """Return the temperature in the solved stages; a manual recording, which names none, is solved as a whole."""
        rows = self._temperatures[True] or self._temperatures[False]
        if not rows:
            return None
        counts, sums, lowest, highest = zip(*rows, strict=True)
        return Temperature(mean=round(sum(sums) / sum(counts), 3), min=min(lowest), max=max(highest))

    def record(self, done: float, stage: str) -> None:
        time_now = done * self._length / self._rate
        self.spans[stage] = (self.spans.get(stage, (time_now, time_now))[0], time_now)
        if not self.time or time_now > self.time[-1]:
            self.time.append(time_now)
            self.sigma.append(self.chain.sigma())

    def finish(self) -> None:
        self.unused.close()
        self.time.append(self._length / self._rate)
        self.sigma.append(self.chain.solutions[-1].posterior.sigma)


def analyse(report: ProgressCallback, log: Log, result: Result) -> Analysis:
    """Analyse the samples of the log of a result by solving the log several times.

    Raises InputError, for example if the log does not reproduce the values or the verdict of the result.
    """
    meta, _ = with_states(log.meta, tuple(result.states_added))
    recorder = _SigmaRecorder(log, meta, result)

    def on_progress(done: float, stage: str) -> None:
        report(_SOLVED * done, note=stage)
        recorder.record(done, stage)

    chain = solve_again(log, result, meta, on_progress, recorder.chain, recorder.observe)
    recorder.finish()
    _check(result, log, chain)
    with one_blas_thread():
        diagnostics = stage_diagnostics(log, chain, result.log.first_seq, result.log.last_seq)
    report(_RESIDUALS)
    budget = uncertainty_budget(
        log, result, meta, chain, lambda done, stage: report(_RESIDUALS + (1.0 - _RESIDUALS) * done, note=stage)
    )
    return Analysis(
        np.array(recorder.time),
        np.array(recorder.sigma),
        recorder.spans,
        {d.stage: d.rests for d in diagnostics},
        chain.prior.sigma,
        chain.solutions[-1].posterior.sigma,
        budget,
        chain.model_tests.effects_tested,
        recorder.unused.invalid,
        recorder.temperature(),
        tuple(_warnings(log)),
        next((e["values"] for e in log.events if e.get("event") == "Message" and e.get("id") == "identified"), {}),
        completed_rounds(log.events),
    )


def _check(result: Result, log: Log, chain: StageChain) -> None:
    """Raise InputError if a result differs from its log's solution by more than rounding, or passed but should fail."""
    solutions = tuple(chain.solutions)
    solved = solved_parameters(solutions)
    for name, row in result.parameters.items():
        parameter = solved.get(name)
        if parameter is None or not _is_consistent(row, parameter):
            raise InputError("report.other_values", file=log.path, parameter=name)
    if result.passed and judge(log.meta, chain.prior, solutions).passed is False:
        raise InputError("report.other_verdict", file=log.path)


def _is_consistent(row: Parameter, parameter: Parameter) -> bool:
    """Return whether the value and the sigma agree within a thousandth of the sigma."""
    tolerance = ROUNDING * parameter.sigma
    pairs = ((row.value, parameter.value), (row.sigma, parameter.sigma))
    return all(np.isclose(a, b, rtol=0.0, atol=tolerance, equal_nan=True) for a, b in pairs)


def _warnings(log: Log) -> Iterator[Text]:
    """Yield each warning of the run only once."""
    seen: set[str] = set()
    for event in log.events:
        if event.get("event") != "Message":
            continue
        text = event_text(event["id"], values_from_json(event["values"]))
        if known(text.code) and entry(text.code).severity == "warning" and str(text) not in seen:
            seen.add(str(text))
            yield text
