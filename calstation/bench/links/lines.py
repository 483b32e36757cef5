"""Serial lines of the unit and of a table with a text protocol: TCP listeners or pseudo-terminals.

The unit's line waits for a slow reader, so that no samples are lost.
"""

import asyncio
import os
import select
import socket
import sys
from collections.abc import Callable

from calstation.bench.table import TextController


def open_raw() -> tuple[int, int, str]:
    """A new pseudo-terminal that passes bytes unchanged: master (non-blocking), slave, path of the slave.

    Raises OSError on platforms that have none.
    """
    if sys.platform == "win32":
        raise OSError("pseudo-terminals do not exist on Windows: use socket://")
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    return master, slave, os.ttyname(slave)


#: Kernel buffer of the line, bytes: a reader with a larger backlog stops the bench's time.
BUFFER = 65536

#: Creates the parser of one connection, which takes received bytes and returns the unit's replies.
Talk = Callable[[], Callable[[bytes], list[bytes]]]


async def _late(reply: bytes, slow: list[float]) -> bytes:
    """The reply, after the ordered delay."""
    if reply and slow:
        await asyncio.sleep(slow.pop(0))
    return reply


class SocketLine:
    """The unit's line as a TCP listener on 127.0.0.1, which serves the client that connected last.

    Attributes
    ----------
    endpoint : "socket://host:port"
    sent : bytes handed to the operating system for the present client
    slow : delays of the next replies, host time, s
    """

    def __init__(self, talk: Talk) -> None:
        self.endpoint = ""
        self.sent = 0
        self.slow: list[float] = []
        self._talk = talk
        self._server: asyncio.Server | None = None
        self._writer: asyncio.StreamWriter | None = None

    async def open(self, port: int = 0) -> None:
        """Listen, by default on a free port."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", port)
        host, port = self._server.sockets[0].getsockname()[:2]
        self.endpoint = f"socket://{host}:{port}"

    async def send(self, data: bytes) -> None:
        """Hand bytes to the operating system; they are lost without a client."""
        writer = self._writer
        if writer is None or not data:
            return
        self.sent += len(data)
        try:
            writer.write(data)
            await writer.drain()
        except ConnectionError:
            self._drop(writer)

    def hang_up(self) -> None:
        """Disconnect the client."""
        if self._writer is not None:
            self._drop(self._writer)

    async def close(self) -> None:
        """Stop listening."""
        self.hang_up()
        if self._server is not None:
            self._server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.hang_up()
        connection = writer.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        writer.transport.set_write_buffer_limits(high=0)
        self._writer, self.sent = writer, 0
        answer = self._talk()
        try:
            while data := await reader.read(4096):
                for reply in answer(data):
                    await self.send(await _late(reply, self.slow))
        except (ConnectionError, asyncio.CancelledError):
            pass
        finally:
            self._drop(writer)

    def _drop(self, writer: asyncio.StreamWriter) -> None:
        if self._writer is writer:
            self._writer = None
        writer.close()


class TerminalLine:
    """The unit's line as a pseudo-terminal (posix); bytes are lost while no process has it open.

    Attributes
    ----------
    endpoint : path to open
    sent : bytes handed to the present terminal
    slow : delays of the next replies, host time, s
    """

    #: Polling interval of the terminal, host time, s.
    POLL = 0.002

    def __init__(self, talk: Talk) -> None:
        self.endpoint = ""
        self.sent = 0
        self.slow: list[float] = []
        self._talk = talk
        self._master = -1
        self._task: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Create the terminal."""
        self._make()
        self._task = asyncio.create_task(self._read())

    async def send(self, data: bytes) -> None:
        """Hand bytes to the terminal, waiting for its reader; they are lost without a reader."""
        while data and self._attended():
            try:
                written = os.write(self._master, data)
            except BlockingIOError:
                await asyncio.sleep(self.POLL / 4)
                continue
            except OSError:
                return
            self.sent += written
            data = data[written:]

    def hang_up(self) -> None:
        """Unplug the adapter and plug it in again: a terminal with another name replaces the present one."""
        gone = self._master
        self._make()
        os.close(gone)

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
        # With our own end of the slave closed, the master shows whether another process has it open.
        os.close(slave)

    def _attended(self) -> bool:
        if sys.platform == "win32":
            return False
        poll = select.poll()
        poll.register(self._master, select.POLLOUT)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    async def _read(self) -> None:
        answer, plugged = self._talk(), self._master
        while True:
            if plugged != self._master:
                answer, plugged = self._talk(), self._master
            try:
                data = os.read(self._master, 4096)
            except OSError:
                data = b""
            for reply in answer(data):
                await self.send(await _late(reply, self.slow))
            await asyncio.sleep(self.POLL)


class TableLine:
    """A running line.

    Attributes
    ----------
    endpoint : "host:port" of the TCP listener, or the path of the terminal
    mute : lines still to be left without an answer
    """

    def __init__(self, controller: TextController) -> None:
        self.endpoint = ""
        self.mute = 0
        self._controller = controller
        self._server: asyncio.Server | None = None
        self._terminal: tuple[int, int] | None = None

    async def serve_tcp(self, port: int = 0) -> None:
        """Listen on 127.0.0.1, by default on a free port."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", port)
        host, number = self._server.sockets[0].getsockname()[:2]
        self.endpoint = f"{host}:{number}"

    async def serve_rtu(self) -> None:
        """Serve on a new pseudo-terminal (posix)."""
        if sys.platform == "win32":
            raise OSError("pseudo-terminals do not exist on Windows: use the TCP transport")
        master, slave, self.endpoint = open_raw()
        self._terminal = (master, slave)
        asyncio.get_running_loop().add_reader(master, self._take, master)

    async def close(self) -> None:
        """Stop serving."""
        if self._server is not None:
            self._server.close()
        if self._terminal is not None and sys.platform != "win32":
            asyncio.get_running_loop().remove_reader(self._terminal[0])
            for end in self._terminal:
                os.close(end)
            self._terminal = None

    def _answer(self, data: bytes) -> bytes:
        replies = []
        for reply in self._controller.feed(data):
            if self.mute > 0:
                self.mute -= 1
            else:
                replies.append(reply)
        return b"".join(replies)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while data := await reader.read(4096):
                writer.write(self._answer(data))
                await writer.drain()
        except (ConnectionError, asyncio.CancelledError):
            pass
        finally:
            writer.close()

    def _take(self, master: int) -> None:
        try:
            os.write(master, self._answer(os.read(master, 4096)))
        except OSError:
            return
