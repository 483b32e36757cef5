"""`watch`: monitors IMUs on one body, in a log or live, and calibrates the IMUs that are out of tolerance."""

import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from calstation.cli.options import JsonOption, ProductOption, by_name, command_group, document_file
from calstation.cli.show import emit_json, on_line, plain_console, show_line, three_digits
from calstation.cli.text import say, sentence
from calstation.config import RunRequest, load_pair_configuration, load_station, pair_folder
from calstation.connection import LineServer, open_pair
from calstation.errors import ConfigurationError, InputError, StoppedError
from calstation.estimation.common import SampleBlock
from calstation.estimation.pairs import SENSORS, PairWatch, RestDeviation, WatchEvent
from calstation.jobs import on_stop_signals
from calstation.messages import os_reason
from calstation.physics import DEGREE, DEGREE_PER_HOUR, MICRO_G
from calstation.records import LogMeta, open_log
from calstation.results import CorrectedOutput, PairWatchResult, pair_report, watch_log

#: Values in SI below which a threshold is shown in °/h or µg.
_MAX_SMALL_RATE, _MAX_SMALL_FORCE = 0.1 * DEGREE, 10_000 * MICRO_G
#: Longest time for which a replay waits for a slow client before a line is dropped, s.
_REPLAY_TIMEOUT = 10.0
#: Interval of the messages while a live session waits for rest or motion, s.
_STATE_INTERVAL = 5.0


app = command_group()


@app.command()
def watch(
    log: Annotated[Path | None, typer.Argument(metavar="LOG")] = None,
    station: Annotated[Path | None, typer.Option(callback=by_name("stations"))] = None,
    product: ProductOption = None,
    serial: str = "",
    seconds: Annotated[float | None, typer.Option(min=0.0)] = None,
    json: JsonOption = None,
    folder: Annotated[Path | None, typer.Option("--pairs")] = None,
    command: Annotated[bool, typer.Option("--now")] = False,
    serve: Annotated[str | None, typer.Option(metavar="HOST:PORT")] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE.jsonl", parser=document_file)] = None,
) -> int:
    """Monitor IMUs on one body, in a log or live, and calibrate the sensors that are out of tolerance.

    The calibrations are stored. Returns 0 if every sensor was within its threshold at the last check or has been
    calibrated, every IMU sends data at the end, and all data were written; otherwise 1, or the exit code of a stop
    after Ctrl-C.
    """
    delivery = Delivery(serve, out)
    if log is not None and station is None:
        return _watch_log(log, folder, command, json, delivery)
    if station is not None and log is None:
        return _watch_station(RunRequest(serial, station, product), folder, command, seconds, json, delivery)
    raise ConfigurationError("cli.log_or_station")


@dataclass(frozen=True)
class Delivery:
    """Destinations of the corrected data."""

    serve: str | None = None  #: ``HOST:PORT`` of a service for other programs.
    file: Path | None = None  #: File of JSON lines.


class _LinesFile:
    """A file of lines; after the first failure, which is shown on `out`, nothing more is written and `failed` is set.

    Raises ConfigurationError if the file cannot be opened.
    """

    def __init__(self, path: Path, out: Console) -> None:
        self._path, self._out, self.failed = path, out, False
        try:
            self._file = path.open("w", buffering=1, encoding="utf-8")  # other programs always read complete lines
        except OSError as exc:
            raise self._error(exc) from exc

    def write(self, line: str) -> None:
        """Write a line."""
        if self.failed:
            return
        try:
            self._file.write(line)
        except OSError as exc:
            self.failed = True
            show_line(self._out, sentence(self._error(exc).as_text))

    def close(self) -> None:
        """Close the file."""
        with suppress(OSError):  # writing the buffered data fails again if the disk is full
            self._file.close()

    def _error(self, exc: OSError) -> ConfigurationError:
        return ConfigurationError("result.unwritable", file=self._path, reason=os_reason(exc))


def _watch_log(log: Path, folder: Path | None, command: bool, json: str | None, delivery: Delivery) -> int:
    out, file = _console(json), delivery.file
    if file is not None and file.exists() and file.samefile(log):
        raise InputError("csv.export_onto_itself", file=file)
    with _deliver(open_log(log).meta, delivery, out, replay=True) as (consumers, all_written):
        result = watch_log(log, folder or pair_folder(), command, [_EventPrinter(out), *consumers])
    _show_checks(out, result)
    emit_json(pair_report(result), json)
    return 0 if result.within and all_written() else 1


def _watch_station(
    request: RunRequest,
    folder: Path | None,
    command: bool,
    seconds: float | None,
    json: str | None,
    delivery: Delivery,
) -> int:
    """Monitor until `seconds` of device time have passed or Ctrl-C is pressed; the input ``c`` requests a check."""

    def check_cancelled() -> None:
        if stop.is_set():
            raise StoppedError("cli.stopped")

    out, stop = _console(json), threading.Event()
    _, station = load_station(request.station)
    setup = load_pair_configuration(
        RunRequest(request.serial or station.virtual_serial, request.station, request.product)
    )
    with on_stop_signals(stop.set), open_pair(setup, folder or pair_folder(), check_cancelled) as live:
        watch = live.session.watch
        if command:
            watch.command()
        on_line("c", watch.command)
        with _deliver(live.session.meta, delivery, out) as (consumers, all_written):
            printer = _EventPrinter(out, waiting=True)
            result = live.session.run(live.blocks(seconds, stop.is_set), [printer, *consumers], stop.is_set)
    _show_checks(out, result)
    emit_json(pair_report(result, live.alignments()), json)
    if stop.is_set():
        return StoppedError.exit_code
    return 0 if result.within and all_written() else 1


def _console(json: str | None) -> Console:
    """Return the console for events, which is standard output unless the JSON is written there."""
    return plain_console(file=sys.stderr if json == "-" else sys.stdout)


@contextmanager
def _deliver(
    meta: LogMeta, delivery: Delivery, out: Console, *, replay: bool = False
) -> Iterator[tuple[list[CorrectedOutput], Callable[[], bool]]]:
    """Deliver corrected data while the context is open; a replay waits for the first client and for slow ones.

    Yields the consumers, and a function that returns whether the file, if any, contains all lines.
    Raises ConfigurationError if the service or the file cannot be opened.
    """
    sinks: list[Callable[[str], object]] = []
    with ExitStack() as stack:
        file = None if delivery.file is None else _LinesFile(delivery.file, out)
        if file is not None:
            stack.callback(file.close)
            sinks.append(file.write)
        server = None if delivery.serve is None else LineServer(delivery.serve, _REPLAY_TIMEOUT if replay else 0.0)
        if server is not None:
            stack.callback(server.close)
            sinks.append(server.write)
        if not sinks:
            yield [], lambda: True
            return
        output = CorrectedOutput(meta, sinks)
        if server is not None:
            server.greeting = lambda: output.greeting
            show_line(out, say("cli.serving", address=server.address))
            while replay and not server.wait_for_client(0.2):
                pass  # Ctrl-C ends the wait
        yield [output], lambda: file is None or not file.failed


class _EventPrinter:
    """Prints the events of a session and, if `waiting` is set, its state while it waits for rest or motion.

    Times are relative to the first sample, as in the window.
    """

    def __init__(self, out: Console, *, waiting: bool = False) -> None:
        self._out, self._waiting = out, waiting
        self._last_state = ("", 0.0)
        self._start: float | None = None

    def feed(self, block: SampleBlock, watch: PairWatch, events: Sequence[WatchEvent]) -> None:
        if len(block) and self._start is None:
            self._start = float(block.time[0])
        begin = self._start or 0.0
        for event in events:
            values = {name: _imu_names(value) for name, value in event.values.items()}
            partly = "_partly" if event.values.get("skipped") else ""
            text = say(f"cli.watch_{event.kind}{partly}", **{"number": event.number, **values})
            show_line(self._out, f"{event.time - begin:9.1f} s  {text}")
        if self._waiting and len(block):
            self._show_state(float(block.time[-1]) - begin, watch)

    def _show_state(self, now: float, watch: PairWatch) -> None:
        state, at = self._last_state
        if watch.state == "waiting" or (watch.state == state and now - at < _STATE_INTERVAL):
            return
        self._last_state = (watch.state, now)
        code = "axes" if watch.state == "calibrating" and watch.progress >= 1.0 else watch.state
        show_line(self._out, f"{now:9.1f} s  {say(f'pair.state_{code}', percent=100.0 * watch.progress)}")


def _show_checks(out: Console, result: PairWatchResult) -> None:
    """Print the last check of every sensor and its verdict."""
    for number, check in result.checks.items():
        for sensor in SENSORS:
            verdict = result.verdicts[number][sensor]
            _show_check(out, f"imu{number}", sensor, check.secondary[sensor], verdict)
        for sensor in check.primary_out_of_tolerance:
            _show_check(out, say("cli.primary"), sensor, check.primary[sensor], "out_of_tolerance")
    if not result.checks:
        show_line(out, say("cli.no_rest"))


def _show_check(out: Console, imu: str, sensor: str, deviation: RestDeviation, verdict: str) -> None:
    size, unit = _unit(sensor, deviation.limit)
    value, limit = (f"{three_digits(x / size)} {unit}" for x in (deviation.value, deviation.limit))
    values = {"name": f"{imu} {sensor}", "value": value, "limit": limit, "verdict": say(f"cli.pair_{verdict}")}
    show_line(out, say("cli.pair_check", **values))


def _unit(sensor: str, limit: float) -> tuple[float, str]:
    """Return the size in SI and the name of the unit in which a threshold is shown."""
    if sensor == "gyro":
        return (DEGREE_PER_HOUR, "°/h") if limit < _MAX_SMALL_RATE else (DEGREE, "°/s")
    return (MICRO_G, "µg") if limit < _MAX_SMALL_FORCE else (1.0, "m/s²")


def _imu_names(value: Any) -> Any:
    """Replace the IMU numbers in a list by the names of the IMUs."""
    if not isinstance(value, list | tuple):
        return value
    return [f"imu{item}" if isinstance(item, int) else str(item) for item in value]
