"""The end of a run: its outcome, the recommended action for the unit, and its result file."""

import logging
from contextlib import suppress
from dataclasses import replace

from calstation.config import ProductConfig
from calstation.errors import ConfigurationError
from calstation.judgement import judge, latitude_agrees
from calstation.quality import table_charts
from calstation.records import RunFilter
from calstation.results import Ending, build_result, write_json
from calstation.runs.automatic_report import report_command, start_reports
from calstation.runs.preparation import OpenRun
from calstation.sequencer import Ended, Message, State, Verdict

_OUTCOMES = {State.PASSED: "passed", State.FAILED: "failed", State.STOPPED: "stopped", State.FAULT: "fault"}

logger = logging.getLogger(__name__)


def close_run(run: OpenRun, ended: Ended) -> None:
    """Write the result into the log and next to it; emit the verdict.

    In a batch, the caller starts the report when the table is at rest.
    """
    run.closed = True
    history, log, control = run.prepared.history, run.log, run.prepared.control
    outcome = _OUTCOMES[ended.state]
    failures = history.failures(run.serial) + (outcome == "failed")
    judgement = judge(run.meta, run.chain.prior, ended.solutions)
    finished = bool(ended.solutions) and not run.registers.get("new") and latitude_agrees(judgement.checks)
    ending = Ending(
        outcome,
        str(log.path),
        log.facts(),
        registers=run.registers or None,
        error=ended.error,
        stop_reason=str(control.stop_reason) if outcome == "stopped" else None,
        advice=advice(run.setup.product, outcome, failures, finished),
        cycle=run.prepared.cycle.phases(),
        table=run.chain.table(),
    )
    judgement = replace(judgement, passed=ended.state is State.PASSED)
    result = build_result(run.meta, run.chain.prior, ended.solutions, judgement, ending)
    if run.standard is not None:
        result = result.model_copy(update={"check_standard": run.standard})
    written = result.to_json()
    log.add_result(written)
    log.close(outcome)
    beside = log.path.with_suffix(".json")
    ignored = () if ended.error is None else (ConfigurationError,)  # the fault itself is reported
    with suppress(*ignored):
        write_json(beside, written)
    with suppress(OSError):  # only the index, which the next run restores
        history.refresh()
    logger.info("verdict %s, result %s", outcome, beside)
    if outcome in ("passed", "failed"):
        _report_table(run, beside.stem)
        run.report = report_command(run.setup, beside.absolute(), run.prepared.emit)
        if not run.setup.request.batch:
            start_reports([run.report])
    run.prepared.emit(Verdict(outcome, str(log.path), str(beside), written))


def _report_table(run: OpenRun, name: str) -> None:
    """Emit a message if a control chart of the table's geometry raises an alarm for this run."""
    station, product = run.setup.station, run.setup.product
    charts = table_charts(station, run.prepared.history.columns(RunFilter(product=product.name, station=station.name)))
    moved = [quantity for quantity, chart in charts.items() if name in {chart.names[k] for k in chart.alarms}]
    if moved:
        logger.warning("the geometry of the table has changed: %s", ", ".join(moved))
        run.prepared.emit(Message("table_moved", {"quantities": moved}))


def advice(product: ProductConfig, outcome: str, failures: int, finished: bool) -> str | None:
    """Return the recommended action: ``reseat``, ``repeat``, ``set_aside`` or ``resume``; None for a unit that passed.

    `failures` counts consecutive failed runs, including this one; `finished` is True if the run can be resumed.
    """
    if outcome == "passed":
        return None
    if outcome != "failed":
        return "resume" if finished else "repeat"
    if product.attempts_allowed is not None and failures >= product.attempts_allowed:
        return "set_aside"
    return product.advice[min(failures, len(product.advice)) - 1]
