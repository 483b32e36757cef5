"""The clock service, with JSON lines over TCP that advance or query the bench's time, or inject a fault.

    {"advance": seconds}                 -> {"now": s, "samples": n, "bytes": [n, ...]}
    {"now": null}                        -> the same, immediately
    {"order": name, "value": number}     -> the same, after execution; with {"unit": number} for units other than 1
    {"carry": [outer, inner], "rest": s} -> the same; asks the simulated operator to set the rails to angles, rad
    anything else                        -> {"error": text}

`samples` is the number of samples that the first unit has produced. `bytes` are the numbers of bytes sent to the
current client of each IMU link, 0 once the client has disconnected.
"""

import asyncio
import json
import socket
from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from pydantic import ValidationError

from calstation.bench.config import Order
from calstation.bench.live import LiveBench


class ClockService:
    """TCP server of the clock service.

    `advance` advances time by some seconds and returns when the samples have been sent, `report` returns the fields of
    a reply, and `on_last_disconnect` is called when the last connection has closed.
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
                order = Order.model_validate(request)
                self._unit_for(order).execute(order)
            elif "carry" in request:
                outer, inner = map(float, request["carry"])
                self._units[0].carry(outer, inner, float(request.get("rest", 0.0)))
            elif "now" not in request:
                return {"error": "ask for one of: advance, now, order, carry"}
        except (ValueError, TypeError, ValidationError) as exc:
            return {"error": str(exc)}
        return self._report()

    def _unit_for(self, order: Order) -> LiveBench:
        """Return the unit that executes an order, which for the table is the first unit. Raises ValueError."""
        first = self._units[0]
        if order.of_table or len(self._units) == 1:
            return first
        for unit in self._units:
            if unit.number == order.unit:
                return unit
        raise ValueError(f"there is no unit {order.unit}")
