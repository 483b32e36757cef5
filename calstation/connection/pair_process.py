"""A separate process in which the IMUs on one body are monitored for the window."""

import logging
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from queue import Empty
from typing import Any, Literal

from calstation import applog
from calstation.config import RunRequest, load_pair_configuration, load_station, pair_folder
from calstation.connection.live_pair import LivePair, open_pair
from calstation.errors import CalstationError, StoppedError
from calstation.estimation.common import SampleBlock
from calstation.estimation.pairs import Alignment, PairWatch, WatchEvent, check_values
from calstation.jobs import ChildProcess, receive_stop_signals
from calstation.results import CorrectedTrace, CorrectedTraceBuilder, PairProgress
from calstation.results.plots import StoredPairFile, stored_pairs

#: Host time between two reports, s.
_INTERVAL = 0.25
#: Period covered by the displayed progress of live monitoring, s.
SPAN = 300.0
#: Maximum host time for closing the ports, s.
_CLOSE_TIMEOUT = 15.0

WatchCommand = Literal["check", "stop"]

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PairStatus:
    """The state of live monitoring."""

    schedule: Mapping[str, Any]
    progress: PairProgress  #: Progress in the last `SPAN` s.
    checks: Mapping[int, Mapping[str, Any]]  #: Last check of each secondary by number, see `check_values`.
    static: Mapping[int, Mapping[str, float | None]]  #: Deviations at rest by secondary, see `PairResult.static`.
    alignments: Mapping[int, Alignment]
    stored: tuple[StoredPairFile, ...]
    primary_off: tuple[str, ...]
    silent: frozenset[int]  #: IMUs that send no samples, 0 for the primary.
    corrected: CorrectedTrace


class PairProcess:
    """A process that monitors the IMUs of a station; only `close` waits for it."""

    def __init__(self, request: RunRequest) -> None:
        self._process = ChildProcess("watch", _serve, request)
        self.ended = False

    def poll(self) -> list[PairStatus | CalstationError]:
        """Return the reports since the last call; an error is the last report."""
        reports: list[PairStatus | CalstationError] = []
        while not self.ended:
            try:
                reports.append(self._process.take())
            except Empty:
                break
            except EOFError:
                self.ended = True
        return reports

    def send(self, command: WatchCommand) -> None:
        """Send a request for a check or for the end, unless the process has ended."""
        self._process.send(command)

    def close(self) -> None:
        """End the monitoring and wait until the ports are closed."""
        self.send("stop")
        self._process.end(_CLOSE_TIMEOUT)


class _Reporter:
    """Sends the state of the session to the listener."""

    def __init__(self, connection: "Connection[Any, Any]", live: LivePair) -> None:
        self._connection, self._live = connection, live
        self._schedule = live.session.schedule.model_dump(mode="json")
        self._events: list[WatchEvent] = []
        self._begin: float | None = None
        self._stored = stored_pairs(live.session.context, pair_folder())
        self._corrected = CorrectedTraceBuilder(live.session.meta)
        self._sent = 0.0

    def feed(self, block: SampleBlock, watch: PairWatch, events: Sequence[WatchEvent]) -> None:
        self._corrected.feed(block, watch, events)
        # the clocks are displayed separately
        self._events += [event for event in events if event.kind != "aligned"]
        if any(event.kind == "calibrated" for event in events):
            self._stored = stored_pairs(self._live.session.context, pair_folder())
        if not len(block) or (not events and time.monotonic() - self._sent < _INTERVAL):
            return
        self._sent, end = time.monotonic(), float(block.time[-1])
        self._begin = float(block.time[0]) if self._begin is None else self._begin
        start = max(self._begin, end - SPAN)
        self._events = [event for event in self._events if event.time >= start]
        recent_events = tuple(WatchEvent(e.kind, e.time - start, e.number, e.values) for e in self._events)
        progress = PairProgress(end - start, SPAN, watch.state, watch.progress, recent_events)
        checks = {number: check_values(check) for number, check in watch.checks.items()}
        static = {n: r.static for n, r in watch.calibrated.items() if "calibrated" in watch.verdicts[n].values()}
        self._connection.send(
            PairStatus(
                self._schedule,
                progress,
                checks,
                static,
                self._live.alignments(),
                self._stored,
                watch.primary_off,
                watch.silent,
                self._corrected.trace(),
            )
        )


def _serve(connection: "Connection[Any, Any]", request: RunRequest) -> None:
    """Run the process until its listener disconnects or stops it."""
    applog.configure("watch")
    receive_stop_signals()
    stopped, check = threading.Event(), threading.Event()

    def receive() -> None:
        with suppress(EOFError, OSError):
            while True:
                (stopped if connection.recv() == "stop" else check).set()
        stopped.set()

    def check_cancelled() -> None:
        if stopped.is_set():
            raise StoppedError("cli.stopped")

    threading.Thread(target=receive, name="commands", daemon=True).start()
    try:
        _, station = load_station(request.station)
        serial = request.serial or station.virtual_serial
        setup = load_pair_configuration(RunRequest(serial, request.station, request.product))
        with open_pair(setup, pair_folder(), check_cancelled) as live:

            def ended() -> bool:
                if check.is_set():
                    check.clear()
                    live.session.watch.command()
                return stopped.is_set()

            live.session.run(live.blocks(None, ended), [_Reporter(connection, live)], ended)
    except StoppedError:
        pass
    except OSError:
        logger.info("the listener disconnected")
    except CalstationError as error:
        with suppress(OSError):
            connection.send(CalstationError(error.code, **error.values))
    except Exception as error:
        logger.exception("the watch ended with a programming error")
        with suppress(OSError):
            connection.send(CalstationError("program.internal", detail=f"{type(error).__name__}: {error}"))
