"""The line of a table that takes text: a TCP listener, or a pseudo-terminal."""

import asyncio
import os
import sys

from calstation.bench.links.pseudo_terminal import open_raw
from calstation.bench.table.text import TextController


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
        """Listen on 127.0.0.1, on a free port where none is told."""
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
