"""Simulated serial lines of units and tables, which are TCP servers or pseudo-terminals."""

import asyncio
import os
import select
import socket
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable

#: Size of the kernel buffer of a line, bytes; the time of the bench stops while a reader has a larger backlog.
BUFFER_SIZE = 65536

#: Polling interval of a terminal, host time, s.
POLL_INTERVAL = 0.002

#: Function that creates the parser of one connection, which converts received bytes to replies.
ParserFactory = Callable[[], Callable[[bytes], list[bytes]]]


def open_raw() -> tuple[int, int, str]:
    """Open a raw pseudo-terminal; return the non-blocking master, the slave and the path of the slave.

    Raises OSError on platforms without pseudo-terminals.
    """
    if sys.platform == "win32":
        raise OSError("pseudo-terminals do not exist on Windows: use a TCP transport")
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    return master, slave, os.ttyname(slave)


class _Line(ABC):
    """A line to one client, which waits for a slow reader so that no samples are lost.

    `endpoint` is the address for clients. `sent` is the number of bytes sent to the current client; it is 0 after the
    client has closed the line. `reply_delays` are the delays of the next replies, host time, s.
    """

    def __init__(self, new_parser: ParserFactory) -> None:
        self.endpoint = ""
        self.sent = 0
        self.reply_delays: list[float] = []
        self._new_parser = new_parser

    @abstractmethod
    async def send(self, data: bytes) -> None:
        """Send bytes; they are lost if there is no client."""

    async def _reply(self, replies: list[bytes]) -> None:
        for reply in replies:
            if reply and self.reply_delays:
                await asyncio.sleep(self.reply_delays.pop(0))
            await self.send(reply)


class SocketLine(_Line):
    """A line that is a TCP server on 127.0.0.1 for the client that connected last."""

    def __init__(self, new_parser: ParserFactory) -> None:
        super().__init__(new_parser)
        self._server: asyncio.Server | None = None
        self._writer: asyncio.StreamWriter | None = None

    async def open(self) -> None:
        """Listen on a free port."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        host, port = self._server.sockets[0].getsockname()[:2]
        self.endpoint = f"socket://{host}:{port}"

    async def send(self, data: bytes) -> None:
        """Send bytes to the client, waiting while its buffer is full."""
        writer = self._writer
        if writer is None or not data:
            return
        self.sent += len(data)
        try:
            writer.write(data)
            await writer.drain()
        except ConnectionError:
            self.sent = 0
            self._drop(writer)

    def hang_up(self) -> None:
        """Disconnect the client."""
        if self._writer is not None:
            self._drop(self._writer)

    async def close(self) -> None:
        """Disconnect the client and stop listening."""
        self.hang_up()
        if self._server is not None:
            self._server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.hang_up()
        connection = writer.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_SIZE)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        writer.transport.set_write_buffer_limits(high=0)
        self._writer, self.sent = writer, 0
        parse = self._new_parser()
        try:
            while data := await reader.read(4096):
                await self._reply(parse(data))
        except (ConnectionError, asyncio.CancelledError):
            pass
        finally:
            if self._writer is writer:
                self.sent = 0
            self._drop(writer)

    def _drop(self, writer: asyncio.StreamWriter) -> None:
        if self._writer is writer:
            self._writer = None
        writer.close()


class TerminalLine(_Line):
    """A line that is a pseudo-terminal (POSIX); bytes are lost while no process has opened it."""

    def __init__(self, new_parser: ParserFactory) -> None:
        super().__init__(new_parser)
        self._master = -1
        self._task: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Create the terminal."""
        self._make()
        self._task = asyncio.create_task(self._read())

    async def send(self, data: bytes) -> None:
        """Write bytes to the terminal, waiting while its buffer is full."""
        while data:
            if not self._is_open():
                self.sent = 0
                return
            try:
                written = os.write(self._master, data)
            except BlockingIOError:
                await asyncio.sleep(POLL_INTERVAL / 4)
                continue
            except OSError:
                return
            self.sent += written
            data = data[written:]

    def hang_up(self) -> None:
        """Replace the terminal by one with another name, as if the adapter were unplugged and plugged in again."""
        unplugged = self._master
        self._make()
        os.close(unplugged)

    async def close(self) -> None:
        """Close the terminal."""
        if self._task is not None:
            self._task.cancel()
        if self._master >= 0:
            os.close(self._master)
            self._master = -1

    def _make(self) -> None:
        self._master, slave, self.endpoint = open_raw()
        self.sent = 0
        # If this process has closed the slave end, the master indicates whether another process has opened it.
        os.close(slave)

    def _is_open(self) -> bool:
        if sys.platform == "win32":
            return False
        poll = select.poll()
        poll.register(self._master, select.POLLOUT)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    async def _read(self) -> None:
        parse, plugged = self._new_parser(), self._master
        while True:
            if plugged != self._master:
                parse, plugged = self._new_parser(), self._master
            try:
                data = os.read(self._master, 4096)
            except OSError:
                data = b""
            await self._reply(parse(data))
            await asyncio.sleep(POLL_INTERVAL)


Line = SocketLine | TerminalLine
