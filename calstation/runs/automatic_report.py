"""Starts the report of a verdict in a process of its own, which neither delays nor endangers the engine."""

import logging
import subprocess
import sys
from pathlib import Path

from calstation.config import ResolvedConfiguration, confirmation_required
from calstation.reports import station_request
from calstation.sequencer import Emit, Message

#: Processes that may outlive the engine; without a reference, Python would warn of them.
_started: list[subprocess.Popen[bytes]] = []

logger = logging.getLogger(__name__)


def start_report(setup: ResolvedConfiguration, result_file: Path, emit: Emit) -> None:
    """Start the report of a result if the station asks for one; its errors are in the application log.

    A certificate that a second person must confirm is not made automatically; a message says that it waits.
    """
    section, source = setup.station.report, setup.sources.get("station")
    if section is None or section.folder is None or source is None:
        return
    if confirmation_required("certificate", setup.product, setup.station).second:
        logger.warning("no automatic report of %s: a second person must confirm its certificate", result_file)
        emit(Message("certificate_waits"))
        return
    request = station_request(source.path, section, result_file)
    out = request.out
    command = [sys.executable, "-m", "calstation", "report", str(request.source), "-o", str(out)]
    command += ["--language", section.language]
    for option, path in (("--templates", request.templates), ("--sign", request.signing)):
        command += [] if path is None else [option, str(path)]
    nothing = subprocess.DEVNULL
    try:
        process = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True)
    except OSError:
        logger.exception("the report of %s was not started", result_file)
        return
    _started.append(process)
    logger.info("report of %s started: %s", result_file, out)
