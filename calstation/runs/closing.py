"""The end of a run: its verdict, its result file, and the report that is made automatically.

Reports are made in separate processes, which cannot delay or stop the engine.
"""

import json
import logging
import subprocess
import sys
from collections.abc import Iterable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from threading import Thread

from calstation.config import RunConfiguration, confirmation_required, missing_report_paths
from calstation.errors import ConfigurationError
from calstation.judgement import End, advice, judge, latitude_agrees, remedy_of, verdict_of
from calstation.quality import table_charts
from calstation.records import RunFilter, Verdict, stages_ended_by_hand
from calstation.reports import station_request
from calstation.results import Ending, build_result, write_json
from calstation.runs.preparation import OpenRun
from calstation.runs.resume import registers_written
from calstation.schema import EntryError
from calstation.sequencer import Emit, Finalized, Message, RunEnd, State

_ENDS = {State.DONE: End.COMPLETED, State.STOPPED: End.STOPPED, State.FAULT: End.FAULT}

#: Program that runs commands one after another, so that only one report is made at a time.
_RUN_IN_SEQUENCE = "import json, subprocess, sys\nfor command in json.loads(sys.argv[1]):\n    subprocess.run(command)"

#: Longest time for which an unresponsive network share may delay the verdict, s.
_SEARCH_TIMEOUT = 2.0

#: Processes that may outlive the engine; without a reference, Python would issue a warning about them.
_started: list[subprocess.Popen[bytes]] = []

logger = logging.getLogger(__name__)


def close_run(run: OpenRun, ended: RunEnd) -> None:
    """Write the result into the log and next to it, and emit the verdict, which a failure to write does not change.

    A run that ended early is judged by the stages that it solved. The caller starts the reports of a batch after the
    table has stopped.
    """
    run.closed = True
    history, log, control = run.prepared.history, run.log, run.prepared.control
    judgement = ended.judgement or judge(run.meta, run.chain.prior, ended.solutions)
    verdict = verdict_of(_ENDS[ended.state], judgement.passed, partial=judgement.partial)
    failures = history.failures(run.serial, run.setup.product.name) + (verdict is Verdict.FAILED)
    written = bool(run.registers.get("new")) or registers_written(run.meta, log.path.parent)
    resumable = bool(ended.solutions or ended.points) and not written and latitude_agrees(judgement.checks)
    by_hand = stages_ended_by_hand(log.stage_ends, run.meta.schedule)
    has_calibration = run.meta.run is not None and run.meta.run.calibration is not None
    shortened = bool(by_hand) and (has_calibration or not judgement.partial)
    ending = Ending(
        verdict,
        str(log.path),
        log.facts(),
        registers=run.registers or None,
        error=ended.error,
        stop_reason=str(control.stop_reason) if verdict is Verdict.STOPPED else None,
        advice=advice(
            run.setup.product,
            verdict,
            failures,
            resumable=resumable,
            shortened=bool(by_hand),
            remedy=remedy_of(judgement.checks, partial=judgement.partial and not shortened),
        ),
        cycle=run.prepared.cycle.phases(),
        ended_utc=datetime.now(UTC).isoformat(),
        table=run.chain.table(),
        ended_by_hand=by_hand,
    )
    result = build_result(run.meta, run.chain.prior, ended.solutions, judgement, ending).to_json()
    result_file = log.path.with_suffix(".json")
    not_written = dict[str, ConfigurationError]()
    for write in (
        lambda: log.add_result(result),
        lambda: log.close(verdict.outcome),
        lambda: write_json(result_file, result),
    ):
        try:
            write()
        except ConfigurationError as error:
            not_written.setdefault(error.code, error)
    for failure in not_written.values():
        logger.error("%s", failure)
        if ended.error is None or failure.code != ended.error.code:
            run.prepared.emit(Message("not_stored", {"serial": run.serial, "reason": failure.as_text}))
    with suppress(OSError):  # the next run restores the index
        history.refresh()
    logger.info("verdict %s, result %s", verdict, result_file)
    if verdict.judged and result_file.exists():
        _report_table(run, result_file.stem)
        run.report = report_command(run.setup, result_file.absolute(), run.prepared.emit)
        if not run.setup.request.batch:
            start_reports([run.report])
    run.prepared.emit(Finalized(verdict, str(log.path), str(result_file), result))


def _report_table(run: OpenRun, name: str) -> None:
    """Emit a message if a control chart of the table geometry raises an alarm for this run."""
    station, product = run.setup.station, run.setup.product
    charts = table_charts(station, run.prepared.history.columns(RunFilter(product=product.name, station=station.name)))
    changed = [quantity for quantity, chart in charts.items() if name in {chart.names[k] for k in chart.alarms}]
    if changed:
        logger.warning("the geometry of the table has changed: %s", ", ".join(changed))
        run.prepared.emit(Message("table_moved", {"quantities": changed}))


def report_command(setup: RunConfiguration, result_file: Path, emit: Emit) -> list[str]:
    """Return the command that makes the report of a result, or [] if the station does not request reports.

    If a second person must confirm the certificate, it is not made automatically, and a message says so. Another
    message is emitted if a folder or file that the certificate needs is missing.
    """
    section, source = setup.station.report, setup.sources.get("station")
    if section is None or section.folder is None or source is None:
        return []
    if confirmation_required("certificate", setup.product, setup.station).second:
        logger.warning("no automatic report of %s: a second person must confirm its certificate", result_file)
        emit(Message("certificate_waits"))
        return []
    missing: list[EntryError] = []
    search = Thread(target=lambda: missing.extend(missing_report_paths(section, source.path)), daemon=True)
    search.start()
    search.join(_SEARCH_TIMEOUT)
    if missing:
        logger.warning("no automatic report of %s: %s", result_file, missing[0])
        emit(Message("certificate_not_made", {"path": str(missing[0].values["path"])}))
        return []
    request = station_request(source.path, section, result_file)
    command = [sys.executable, "-m", "calstation", "report", str(request.source), "-o", str(request.out)]
    command += ["--language", "zh" if request.language == "zh_CN" else "en", "--by", ""]  # made by the program
    for option, path in (("--templates", request.templates), ("--sign", request.signing)):
        command += [] if path is None else [option, str(path)]
    return command


def start_reports(commands: Iterable[list[str]]) -> None:
    """Start the commands of reports in sequence; their errors are written to the application log."""
    requested = [command for command in commands if command]
    if not requested:
        return
    command = requested[0] if len(requested) == 1 else [sys.executable, "-c", _RUN_IN_SEQUENCE, json.dumps(requested)]
    null = subprocess.DEVNULL
    try:
        process = subprocess.Popen(command, stdin=null, stdout=null, stderr=null, start_new_session=True)
    except OSError:
        logger.exception("the reports were not started: %s", requested)
        return
    _started.append(process)
    logger.info("reports started: %s", requested)
