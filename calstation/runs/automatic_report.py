"""Automatic reports after verdicts, made in separate processes that cannot delay or stop the engine."""

import json
import logging
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from threading import Thread

from calstation.config import RunConfiguration, confirmation_required, missing_report_places
from calstation.reports import station_request
from calstation.schema import EntryError
from calstation.sequencer import Emit, Message

#: Program that runs several commands in sequence, so that only one report is made at a time.
_RUN_IN_SEQUENCE = "import json, subprocess, sys\nfor command in json.loads(sys.argv[1]):\n    subprocess.run(command)"

#: Longest time for which an unresponsive network share may delay the verdict, s; the report is started afterwards.
_SEARCH_S = 2.0

#: Processes that may outlive the engine; without a reference, Python would issue a warning about them.
_started: list[subprocess.Popen[bytes]] = []

logger = logging.getLogger(__name__)


def report_command(setup: RunConfiguration, result_file: Path, emit: Emit) -> list[str]:
    """Return the command that makes the report of a result, or [] if the station does not request reports.

    A certificate that a second person must confirm is not made automatically; a message reports that it is pending.
    Another message names a missing folder or file of the station file that a certificate needs.
    """
    section, source = setup.station.report, setup.sources.get("station")
    if section is None or section.folder is None or source is None:
        return []
    if confirmation_required("certificate", setup.product, setup.station).second:
        logger.warning("no automatic report of %s: a second person must confirm its certificate", result_file)
        emit(Message("certificate_waits"))
        return []
    missing: list[EntryError] = []
    search = Thread(target=lambda: missing.extend(missing_report_places(section, source.path)), daemon=True)
    search.start()
    search.join(_SEARCH_S)
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
