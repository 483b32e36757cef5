"""The clock service: JSON lines over TCP that move the bench's time, ask for it, or order a fault.

    {"advance": seconds}                 -> {"now": s, "samples": n, "bytes": n}
    {"now": null}                        -> the same at once
    {"order": name, "value": number}     -> the same, once carried out
    {"carry": [outer, inner], "rest": s} -> the same; the hands at a manual rig have been told (rad)
    anything else                        -> {"error": text}

`samples` counts all samples produced, `bytes` what was handed to the IMU link's present client.
"""

import asyncio
import json
import socket
from collections.abc import Awaitable, Callable
from typing import Any

from pydantic import ValidationError

from calstation.bench import Order


class ClockLink:
    """TCP listener of the clock.

    Parameters
    ----------
    advance : advances time by seconds; returns when the samples are handed over
    obey : carries out an order
    carry : moves the manual rig to rail angles, rad, for a rest, s
    report : gives the fields of an answer
    deserted : called when the last connection has ended
    """

    def __init__(
        self,
        advance: Callable[[float], Awaitable[None]],
        obey: Callable[[Order], None],
        carry: Callable[[float, float, float], None],
        report: Callable[[], dict[str, Any]],
        deserted: Callable[[], None],
    ) -> None:
        self.endpoint = ""
        self._advance, self._obey, self._carry = advance, obey, carry
        self._report, self._deserted = report, deserted
        self._connections = 0
        self._server: asyncio.Server | None = None

    async def open(self, port: int = 0) -> None:
        """Listen on 127.0.0.1."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", port)
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
                writer.write(json.dumps(await self._answer(line)).encode() + b"\n")
                await writer.drain()
        except (ConnectionError, ValueError, asyncio.CancelledError):
            pass
        finally:
            self._connections -= 1
            writer.close()
            if self._connections == 0:
                self._deserted()

    async def _answer(self, line: bytes) -> dict[str, Any]:
        try:
            request = json.loads(line)
            if "advance" in request:
                await self._advance(max(0.0, float(request["advance"])))
            elif "order" in request:
                self._obey(Order.model_validate(request))
            elif "carry" in request:
                outer, inner = map(float, request["carry"])
                self._carry(outer, inner, float(request.get("rest", 0.0)))
            elif "now" not in request:
                return {"error": "ask for one of: advance, now, order, carry"}
        except (ValueError, TypeError, ValidationError) as exc:
            return {"error": str(exc)}
        return self._report()
