"""The windows of a station on this computer; only the first one starts runs."""

import hashlib
import json
from functools import partial
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QStandardPaths, Signal

from calstation.config import DEFAULT_STATION, library
from calstation.gui.state.run_status import RunStatus

if TYPE_CHECKING:
    from pathlib import Path

    from PySide6.QtNetwork import QLocalServer, QLocalSocket

#: Maximum time for the connection to the first window, ms; the operating system accepts it at once.
_CONNECTION_TIMEOUT_MS = 500

#: Message with which another window stops the run of the first window.
_STOP = b"stop\n"


class StationWindows(QObject):
    """The link between the windows of a station, to which only windows of the same user of the computer can connect.

    The first window sends its units and state to the others, which show them as `RunStatus.elsewhere` and pass STOP on
    to the first window. When the first window is closed, another one becomes the first. `changed` is emitted when this
    window becomes the first or ceases to be the first.
    """

    changed = Signal()

    def __init__(self, run: RunStatus, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._run = run
        self._name = ""
        self._station: Path | None = None
        self._server: QLocalServer | None = None
        self._first: QLocalSocket | None = None
        self._others: list[QLocalSocket] = []
        self._sent = b""
        run.changed.connect(self._send)
        run.stop_pressed.connect(self._send_stop)

    def join(self, station: "Path | None") -> None:
        """Join the windows of a station file; None for the virtual bench."""
        from PySide6.QtNetwork import QLocalServer, QLocalSocket  # imported after the first paint

        path = station or library.find("stations", DEFAULT_STATION)
        key = f"{library.site_folder().absolute()}\n{path.absolute()}".encode()
        folder = QStandardPaths.writableLocation(QStandardPaths.StandardLocation.RuntimeLocation)  # only of this user
        name = f"{folder}/calstation-{hashlib.sha256(key).hexdigest()[:24]}"
        if name == self._name:
            return
        self.leave()
        self._name, self._station = name, station
        socket = QLocalSocket(self)
        socket.connectToServer(name)
        if socket.waitForConnected(_CONNECTION_TIMEOUT_MS):
            self._first = socket
            socket.readyRead.connect(self._read)
            socket.disconnected.connect(self._first_closed)
            self._run.set_elsewhere(((), "idle"))
            self.changed.emit()
            return
        QLocalServer.removeServer(name)  # left by a window that was killed
        self._server = QLocalServer(self)
        self._server.setSocketOptions(QLocalServer.SocketOption.UserAccessOption)
        self._server.newConnection.connect(self._accept)
        self._server.listen(name)

    def leave(self) -> None:
        """Leave the windows of the station."""
        self._name, self._sent = "", b""
        first, self._first = self._first, None
        others, self._others = self._others, []
        for socket in filter(None, (first, *others)):
            socket.abort()
            socket.deleteLater()
        if self._server is not None:
            self._server.close()
            self._server.deleteLater()
            self._server = None
        if self._run.elsewhere is not None:
            self._run.set_elsewhere(None)
            self.changed.emit()

    # ---- first window

    def _accept(self) -> None:
        while self._server is not None and (socket := self._server.nextPendingConnection()) is not None:
            self._others.append(socket)
            socket.readyRead.connect(self._read_stop)
            socket.disconnected.connect(partial(self._forget, socket))
            socket.write(self._status())

    def _send(self) -> None:
        """Send the unit and the state of the run to the other windows after a change."""
        if self._others and self._status() != self._sent:
            self._sent = self._status()
            for socket in self._others:
                socket.write(self._sent)

    def _status(self) -> bytes:
        return json.dumps([self._run.serials, self._run.display_state]).encode() + b"\n"

    def _forget(self, closed: "QLocalSocket") -> None:
        self._others = [socket for socket in self._others if socket is not closed]

    def _read_stop(self) -> None:
        for socket in self._others:
            if _STOP in bytes(socket.readAll().data()) and (self._run.in_progress or self._run.program is not None):
                self._run.stop()

    # ---- other windows

    def _send_stop(self) -> None:
        if self._first is not None:
            self._first.write(_STOP)
            self._first.flush()

    def _read(self) -> None:
        while self._first is not None and self._first.canReadLine():
            serials, state = json.loads(bytes(self._first.readLine().data()))
            self._run.set_elsewhere((tuple(serials), state))

    def _first_closed(self) -> None:
        if self._first is not None:  # otherwise this window has left
            self.leave()
            self.join(self._station)
