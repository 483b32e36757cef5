"""Starts the report of a verdict in a process of its own, which neither delays nor endangers the engine."""

import logging
import subprocess
import sys
from pathlib import Path

from calstation.config import ResolvedConfiguration

#: Processes that may outlive the engine; without a reference, Python would warn of them.
_started: list[subprocess.Popen[bytes]] = []

logger = logging.getLogger(__name__)


def start_report(setup: ResolvedConfiguration, result_file: Path) -> None:
    """Start the report of a result if the station asks for one; its errors are in the application log."""
    section, source = setup.station.report, setup.sources.get("station")
    if section is None or section.folder is None or source is None:
        return
    beside = source.path.absolute().parent
    out = beside / Path(section.folder).expanduser() / f"{result_file.stem}.pdf"
    command = [sys.executable, "-m", "calstation", "report", str(result_file), "-o", str(out)]
    command += ["--language", section.language]
    if section.template is not None:
        command += ["--templates", str(beside / Path(section.template).expanduser())]
    if section.signing is not None:
        command += ["--sign", str(beside / Path(section.signing.certificate).expanduser())]
    nothing = subprocess.DEVNULL
    try:
        process = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True)
    except OSError:
        logger.exception("the report of %s was not started", result_file)
        return
    _started.append(process)
    logger.info("report of %s started: %s", result_file, out)
