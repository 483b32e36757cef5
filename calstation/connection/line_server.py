"""A TCP server that sends lines of text to any number of clients."""

import json
import logging
import queue
import socket
import threading
from collections.abc import Callable
from contextlib import suppress

from calstation.errors import ConfigurationError
from calstation.messages import os_reason

#: Number of lines buffered for a client before further lines are dropped.
BUFFERED = 2000
#: Time that a client may take to accept a line before it is disconnected, s.
_TIMEOUT = 10.0
_TICK = 0.1

logger = logging.getLogger(__name__)


class LineServer:
    """A server on ``HOST:PORT`` that sends `greeting` to each new client; port 0 selects a free port.

    If `buffered` lines are waiting for a client, the server waits at most `patience` s before it drops a further line;
    the client then receives the number of dropped lines. Raises ConfigurationError if the address cannot be used.
    """

    def __init__(self, address: str, patience: float = 0.0, buffered: int = BUFFERED) -> None:
        host, _, port = address.rpartition(":")
        if not host or not port.isdecimal() or int(port) > 65535:
            raise ConfigurationError("connection.serve_address", address=address)
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            self._listener = socket.create_server((host.strip("[]"), int(port)), family=family)
        except OSError as exc:
            raise ConfigurationError("connection.serve_unavailable", address=address, reason=os_reason(exc)) from exc
        self.address = f"{host}:{self._listener.getsockname()[1]}"
        self.greeting: Callable[[], str] = str
        self._patience, self._buffered, self._lock = patience, buffered, threading.Lock()
        self._clients: list[_Client] = []
        self._connected = threading.Event()
        self._thread = threading.Thread(target=self._accept, name="line-server", daemon=True)
        self._thread.start()

    def wait_for_client(self, seconds: float) -> bool:
        """Wait at most `seconds` until a client has connected, and return whether one has."""
        return self._connected.wait(seconds)

    def write(self, line: str) -> None:
        """Send a line to all clients."""
        with self._lock:
            self._clients = [client for client in self._clients if client.put(line)]

    def close(self) -> None:
        """Stop listening, and disconnect the clients after sending their buffered lines."""
        with suppress(OSError):  # the shutdown ends a pending accept on systems that support it
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(_TIMEOUT)
        with self._lock:
            for client in self._clients:
                client.finish()
        for client in self._clients:
            client.join()

    def _accept(self) -> None:
        while True:
            try:
                connection, peer = self._listener.accept()
            except OSError:  # the server has been closed
                return
            logger.info("client %s connected", peer)
            with self._lock:
                client = _Client(connection, self._patience, self._buffered)
                client.put(self.greeting())
                self._clients.append(client)
            self._connected.set()


class _Client:
    """A connected client, and the thread that sends its lines."""

    def __init__(self, connection: socket.socket, patience: float, buffered: int) -> None:
        self._connection, self._patience = connection, patience
        connection.settimeout(_TIMEOUT)
        self._lines: queue.Queue[str] = queue.Queue(buffered)
        self._dropped, self._ending, self._is_disconnected = 0, False, False
        self._thread = threading.Thread(target=self._send, name="line-client", daemon=True)
        self._thread.start()

    def put(self, line: str) -> bool:
        """Add a line, or count it as dropped; return False if the client has disconnected."""
        try:
            if self._dropped:
                self._lines.put(_dropped(self._dropped), self._patience > 0.0, self._patience)
                self._dropped = 0
            self._lines.put(line, self._patience > 0.0, self._patience)
        except queue.Full:
            self._dropped += 1
        return not self._is_disconnected

    def finish(self) -> None:
        """End the thread after it has sent the buffered lines."""
        self._ending = True

    def join(self) -> None:
        """Wait for the thread to end."""
        self._thread.join(_TIMEOUT)

    def _send(self) -> None:
        try:
            while True:
                try:
                    line = self._lines.get(timeout=_TICK)
                except queue.Empty:
                    if self._ending:
                        break
                else:
                    self._connection.sendall(line.encode())
            if self._dropped:
                self._connection.sendall(_dropped(self._dropped).encode())
        except OSError as error:
            logger.info("client disconnected: %s", error)
        self._is_disconnected = True
        self._connection.close()


def _dropped(lines: int) -> str:
    return json.dumps({"type": "dropped", "lines": lines}, separators=(",", ":")) + "\n"
