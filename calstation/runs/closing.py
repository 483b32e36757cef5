"""The end of a run: its verdict, its result file, and its report."""

import logging
from contextlib import suppress

from calstation.errors import ConfigurationError
from calstation.judgement import End, advice, judge, latitude_agrees, verdict_of
from calstation.quality import table_charts
from calstation.records import RunFilter, Verdict
from calstation.results import Ending, build_result, write_json
from calstation.runs.automatic_report import report_command, start_reports
from calstation.runs.preparation import OpenRun
from calstation.sequencer import Ended, Finalized, Message, State

_ENDS = {State.DONE: End.COMPLETED, State.STOPPED: End.STOPPED, State.FAULT: End.FAULT}

logger = logging.getLogger(__name__)


def close_run(run: OpenRun, ended: Ended) -> None:
    """Write the result into the log and next to it; emit the verdict.

    A run that ended early is judged by the stages that it solved. In a batch, the caller starts the reports after the
    table has stopped.
    """
    run.closed = True
    history, log, control = run.prepared.history, run.log, run.prepared.control
    judgement = ended.judgement or judge(run.meta, run.chain.prior, ended.solutions)
    verdict = verdict_of(_ENDS[ended.state], judgement.passed, partial=judgement.partial)
    failures = history.failures(run.serial) + (verdict is Verdict.FAILED)
    resumable = bool(ended.solutions) and not run.registers.get("new") and latitude_agrees(judgement.checks)
    ending = Ending(
        verdict,
        str(log.path),
        log.facts(),
        registers=run.registers or None,
        error=ended.error,
        stop_reason=str(control.stop_reason) if verdict is Verdict.STOPPED else None,
        advice=advice(run.setup.product, verdict, failures, resumable=resumable),
        cycle=run.prepared.cycle.phases(),
        table=run.chain.table(),
    )
    result = build_result(run.meta, run.chain.prior, ended.solutions, judgement, ending).to_json()
    log.add_result(result)
    log.close(verdict.outcome)
    result_file = log.path.with_suffix(".json")
    suppressed = () if ended.error is None else (ConfigurationError,)  # the fault itself is reported
    with suppress(*suppressed):
        write_json(result_file, result)
    with suppress(OSError):  # only the index, which the next run restores
        history.refresh()
    logger.info("verdict %s, result %s", verdict, result_file)
    if verdict.judged:
        _report_table(run, result_file.stem)
        run.report = report_command(run.setup, result_file.absolute(), run.prepared.emit)
        if not run.setup.request.batch:
            start_reports([run.report])
    run.prepared.emit(Finalized(verdict, str(log.path), str(result_file), result))


def _report_table(run: OpenRun, name: str) -> None:
    """Emit a message if a control chart of the table's geometry raises an alarm for this run."""
    station, product = run.setup.station, run.setup.product
    charts = table_charts(station, run.prepared.history.columns(RunFilter(product=product.name, station=station.name)))
    changed = [quantity for quantity, chart in charts.items() if name in {chart.names[k] for k in chart.alarms}]
    if changed:
        logger.warning("the geometry of the table has changed: %s", ", ".join(changed))
        run.prepared.emit(Message("table_moved", {"quantities": changed}))
