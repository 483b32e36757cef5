"""The bench process, which serves the devices' links until standard input or the last control connection closes."""

import asyncio
import json
import socket
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from functools import partial
from math import radians
from typing import Any

import numpy as np
from pydantic import ValidationError

from calstation.bench.chamber import ChamberRegisters, Simserv
from calstation.bench.config import BenchConfig, BenchReport, FaultCommand
from calstation.bench.links import Line, ModbusServer, SocketLine, TerminalLine
from calstation.bench.live import LiveBench
from calstation.bench.table import LANGUAGES, Axes, GimbalController, Power, TextController, drives
from calstation.bench.truth import Simulator
from calstation.physics import Dwell, Move, Step

#: Interval between watchdog checks, and between steps of a bench that follows host time, in host time, s.
TICK = 0.005
#: Largest step of device time, s, which limits the number of samples in memory during a long advance.
MAX_STEP = 0.5
#: Largest step of a bench that follows host time, s; requests are processed between steps.
MAX_PACED_STEP = 0.1
#: Largest backlog of host time, s; if the computer is too slow, device time passes more slowly than host time.
MAX_BACKLOG = 1.0
#: Iterations of the event loop before the watchdog is checked, so that pending requests on the table's link are
#: processed first; their delay may be due to the computer, not the client.
_LOOP_ITERATIONS = 3
#: Device time allowed for the table to come to rest after the last client has disconnected, s.
COASTING_TIME = 2.0
#: Faults of the chamber's links.
_CHAMBER_LINK_FAULTS = ("mute_chamber", "slow_chamber", "hang_up_chamber")


class ControlService:
    """A TCP server whose JSON lines advance or query the bench's time, or inject a fault.

        {"advance": seconds}                 -> {"now": s, "samples": n, "bytes": [n, ...]}
        {"now": null}                        -> the same, immediately
        {"order": name, "value": number}     -> the same, after execution, or after scheduling with {"after": seconds}
        {"carry": [outer, inner], "rest": s} -> the same; the simulated operator sets the rails to these angles, rad
        anything else                        -> {"error": text}

    An order is a `FaultCommand`, whose `unit` must be given for units other than 1. `samples` is the number of samples
    that the first unit has produced, and `bytes` the number of bytes sent to the current client of each IMU link, which
    is 0 after the client has disconnected.

    Parameters
    ----------
    units : units of the bench
    advance : coroutine function that advances time by some seconds and returns when the samples have been sent
    report : function that returns the fields of a reply
    on_last_disconnect : function that is called when the last connection has closed
    """

    def __init__(
        self,
        units: Sequence[LiveBench],
        advance: Callable[[float], Awaitable[None]],
        report: Callable[[], dict[str, Any]],
        on_last_disconnect: Callable[[], None],
    ) -> None:
        self.endpoint = ""
        self._units, self._advance, self._report, self._on_last_disconnect = units, advance, report, on_last_disconnect
        self._connections = 0
        self._server: asyncio.Server | None = None

    async def open(self) -> None:
        """Listen on a free port of 127.0.0.1."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        host, port = self._server.sockets[0].getsockname()[:2]
        self.endpoint = f"{host}:{port}"

    async def close(self) -> None:
        """Stop listening."""
        if self._server is not None:
            self._server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._connections += 1
        writer.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            while line := await reader.readline():
                writer.write(json.dumps(await self._reply(line)).encode() + b"\n")
                await writer.drain()
        except (ConnectionError, ValueError, asyncio.CancelledError):
            pass
        finally:
            self._connections -= 1
            writer.close()
            if self._connections == 0:
                self._on_last_disconnect()

    async def _reply(self, line: bytes) -> dict[str, Any]:
        try:
            request = json.loads(line)
            if "advance" in request:
                await self._advance(max(0.0, float(request["advance"])))
            elif "order" in request:
                command = FaultCommand.model_validate(request)
                self._unit_for(command).execute(command)
            elif "carry" in request:
                outer, inner = map(float, request["carry"])
                self._units[0].carry(outer, inner, float(request.get("rest", 0.0)))
            elif "now" not in request:
                return {"error": "ask for one of: advance, now, order, carry"}
        except (ValueError, TypeError, ValidationError) as exc:
            return {"error": str(exc)}
        return self._report()

    def _unit_for(self, command: FaultCommand) -> LiveBench:
        """Return the unit that executes a fault command: the first one for the table. Raises ValueError."""
        first = self._units[0]
        if command.affects_table or len(self._units) == 1:
            return first
        for unit in self._units:
            if unit.number == command.unit:
                return unit
        raise ValueError(f"there is no unit {command.unit}")


class BenchProcess:
    """A bench that runs on an event loop and prints its ports at the start and whenever a port name changes."""

    def __init__(self, config: BenchConfig) -> None:
        self._config = config
        self._bench = bench = LiveBench(_with_faults(config, config), time.monotonic)
        other_units = [LiveBench(_with_faults(config, other), time.monotonic, bench) for other in config.secondaries]
        self._units = [bench, *other_units]
        self._lines: list[Line] = []
        for settings, unit in zip((config, *config.secondaries), self._units, strict=True):
            line = (SocketLine if settings.imu_transport == "socket" else TerminalLine)(unit.new_parser)
            unit.on_link = partial(self._execute, line=line)
            self._lines.append(line)
        self._controller = _controller(config, bench)
        self._table_line: Line | None = None
        if self._controller is not None:
            line_kind = TerminalLine if config.table_transport == "rtu" else SocketLine
            self._table_line = line_kind(self._controller.new_parser)
        self._simserv: Simserv | None = None
        self._chamber_lines: list[SocketLine] = []
        if bench.chamber is not None:
            self._simserv = Simserv(bench.chamber)
            registers = ModbusServer({1: ChamberRegisters(bench.chamber)}, tcp=True)
            self._chamber_lines = [SocketLine(server.new_parser) for server in (self._simserv, registers)]
        self._clock = ControlService(self._units, self._advance, self._report, self.stop)
        self._advance_lock = asyncio.Lock()
        self._advanced = asyncio.Condition()
        self._stopped = asyncio.Event()

    def stop(self) -> None:
        """Request the end of the process."""
        self._stopped.set()

    async def run(self) -> None:
        """Open all links, print them on standard output, and serve until stopped."""
        lines = [line for line in (self._table_line, *self._lines, *self._chamber_lines) if line is not None]
        for line in lines:
            await line.open()
        await self._clock.open()
        ticking = asyncio.create_task(self._tick())
        self._announce()
        try:
            await self._stopped.wait()
            if self._config.report_file is not None:
                await self._wait_for_watchdog()
        finally:
            ticking.cancel()
            for link in (self._clock, *reversed(lines)):
                await link.close()
            self._write_report()

    def _announce(self) -> None:
        """Print the addresses as one JSON object.

        `imu`, `imu2`, ... are URLs or paths of terminals, and `clock`, `chamber` and `chamber_modbus` are "host:port".
        `table` is "host:port" or a path, or the address of the first IMU if the table has no link. `table_transport`
        and `serial` are those of the configuration.
        """
        first, *other_units = self._lines
        table = self._table_line or first
        endpoints = {
            "table": table.endpoint if table is first else table.endpoint.removeprefix("socket://"),
            "table_transport": self._config.table_transport,
            "imu": first.endpoint,
            "clock": self._clock.endpoint,
            "serial": self._config.serial,
            **{
                name: line.endpoint.removeprefix("socket://")
                for name, line in zip(("chamber", "chamber_modbus"), self._chamber_lines, strict=False)
            },
            **{f"imu{number}": line.endpoint for number, line in enumerate(other_units, 2)},
        }
        print(json.dumps(endpoints), flush=True)

    async def _tick(self) -> None:
        """Check the watchdog in host time, and advance device time if it follows host time."""
        speed, last, due = self._config.speed, time.monotonic(), 0.0
        while True:
            await asyncio.sleep(0.0 if due > MAX_PACED_STEP else TICK)
            for _ in range(_LOOP_ITERATIONS):
                await asyncio.sleep(0)
            self._bench.machine.watch(self._bench.clocks.host(), self._bench.device_time)
            if speed > 0.0:
                elapsed, last = time.monotonic() - last, time.monotonic()
                due = min(due + elapsed * speed, MAX_BACKLOG * speed)
                before = self._bench.now
                await self._advance_to(before + min(due, MAX_PACED_STEP))
                due -= self._bench.now - before
                async with self._advanced:
                    self._advanced.notify_all()

    async def _advance(self, seconds: float) -> None:
        until = self._bench.now + seconds
        if self._config.speed == 0.0:
            await self._advance_to(until)
            return
        async with self._advanced:
            await self._advanced.wait_for(lambda: self._bench.now >= until)

    async def _advance_to(self, until: float) -> None:
        async with self._advance_lock:
            while self._bench.now < until:
                now = min(until, self._bench.now + MAX_STEP)
                frames = self._bench.advance(now)
                for other, line in zip(self._units[1:], self._lines[1:], strict=True):
                    sent, other.outbox = b"".join(other.outbox), []
                    await line.send(sent)
                await self._lines[0].send(frames)

    def _report(self) -> dict[str, Any]:
        sent = [line.sent for line in self._lines]
        return {"now": self._bench.now, "samples": self._bench.sample_count, "bytes": sent}

    def _execute(self, command: FaultCommand, line: Line) -> None:
        """Execute a fault command for a link; `line` is the line of the unit."""
        controller, number = self._controller, int(command.value)
        if command.order == "hang_up_imu":
            line.hang_up()
            if isinstance(line, TerminalLine):
                self._announce()
        elif command.order == "slow_imu":
            line.reply_delays.append(command.value)
        elif command.order in _CHAMBER_LINK_FAULTS:
            self._execute_for_chamber_link(command)
        elif command.order == "mute_table" and controller is not None:
            controller.ignored_requests += number
        elif self._table_line is None or not isinstance(controller, ModbusServer):
            return
        elif command.order == "slow_table":
            self._table_line.reply_delays.append(command.value)
        elif command.order == "garble_table":
            controller.corrupted_replies += number
        elif command.order == "refuse_table":
            controller.exception = number

    def _execute_for_chamber_link(self, command: FaultCommand) -> None:
        """Execute a fault command for the links of the chamber if there is one."""
        if self._simserv is not None and command.order == "mute_chamber":
            self._simserv.ignored_requests += int(command.value)
        for line in self._chamber_lines:
            if command.order == "slow_chamber":
                line.reply_delays.append(command.value)
            elif command.order == "hang_up_chamber":
                line.hang_up()

    async def _wait_for_watchdog(self) -> None:
        """Wait until the watchdog has tripped after the table's client has disconnected."""
        machine, deadline = self._bench.machine, time.monotonic() + self._bench.machine.watchdog + 1.0
        while machine.power is Power.ENABLED and machine.watchdog > 0.0 and time.monotonic() < deadline:
            await asyncio.sleep(TICK)
        self._bench.advance(self._bench.now + COASTING_TIME)

    def _write_report(self) -> None:
        if self._config.report_file is not None:
            machine, time = self._bench.machine, self._bench.device_time
            report = BenchReport(
                enabled=machine.power is Power.ENABLED,
                moving=time < machine.drive.end,
                fault=machine.fault.name,
                executed=tuple(name for unit in self._units for name in unit.executed),
                samples=self._bench.sample_count,
                time=time,
                flash_cycles=self._bench.unit.flash.cycles,
            )
            self._config.report_file.write_text(report.model_dump_json(), encoding="utf-8")


def _with_faults(config: BenchConfig, unit: BenchConfig) -> BenchConfig:
    """Return the configuration of a unit with its fault commands; the first unit has also those for the table."""
    if not config.secondaries:
        return unit
    if unit is config:
        return unit.model_copy(
            update={"orders": tuple(o for o in config.orders if o.affects_table or o.unit == unit.unit)}
        )
    added = [o for o in config.orders if not o.affects_table and o.unit == unit.unit != config.unit]
    return unit.model_copy(update={"orders": (*unit.orders, *added)})


def _controller(config: BenchConfig, bench: LiveBench) -> ModbusServer | TextController | None:
    """Return the table's controller, or None if the table has no link."""
    serial, tcp = config.table_serial, config.table_transport == "tcp"
    match config.table_protocol:
        case "modbus":
            return ModbusServer({1: bench.registers}, tcp=tcp)
        case "drives":
            return ModbusServer(drives(bench.machine, bench.clocks, serial), tcp=tcp)
        case "gimbal":
            travel = radians(config.joint_travel_deg)
            return GimbalController(bench.machine, bench.gimbal, bench.clocks, serial, travel)
        case language if language in LANGUAGES:
            return LANGUAGES[language](Axes(bench.machine, bench.clocks), serial)
    return None


def warm_up(config: BenchConfig) -> None:
    """Compile the code that would otherwise delay the first samples, or load it from the cache."""
    steps: list[Step] = [Move(0.01, 0.01, 1.0, 1.0), Dwell(0.1)]
    truth = config.truth()
    Simulator(truth, 0).run(steps, "")
    if config.table_protocol == "gimbal":
        config.gimbal(truth.imu, np.random.SeedSequence(0)).produce(1, np.eye(3))


async def _main(config: BenchConfig) -> None:
    bench = BenchProcess(config)
    loop = asyncio.get_running_loop()

    def wait_for_parent() -> None:
        with suppress(OSError, ValueError):
            while sys.stdin.buffer.read(4096):
                pass
        with suppress(RuntimeError):
            loop.call_soon_threadsafe(bench.stop)

    threading.Thread(target=wait_for_parent, name="parent", daemon=True).start()
    await bench.run()


def serve(config: BenchConfig) -> None:
    """Run a bench until its standard input or its last control connection closes."""
    warm_up(config)
    asyncio.run(_main(config))
