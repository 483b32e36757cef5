"""Locks on the ports of this computer, which ensure that only one process at a time uses a device.

The operating system releases a lock when its process ends. The locks apply to all users and folders of this computer,
but not to other computers at the same table. A virtual bench needs no locks, because only its run uses its ports.
"""

import ipaddress
import json
import multiprocessing
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import quote, urlsplit

from calstation.config import StationConfig, computer_user, load_station
from calstation.devices.links import list_serial_ports, port_device
from calstation.errors import CalstationError, DeviceFaultError
from calstation.messages import os_reason
from calstation.parsing import parse_json
from calstation.records import acquire_lock, is_locked

#: Name of the process that executes a run, for which SIGTERM is a safe stop.
ENGINE = "calstation engine"

#: Host time to wait for a process that is ending to release its lock, s.
_LOCK_TIMEOUT = 3.0


class PortLockError(DeviceFaultError):
    """A port could not be locked, and nothing was sent to its device (exit code 3)."""


@dataclass(frozen=True)
class PortOwner:
    """A process that uses a port, according to its lock file.

    name : name of the process
    parent : id of the process that started it, or None
    """

    file: Path
    pid: int
    user: str
    since: str  #: Time at which it locked the port, ISO 8601 in UTC.
    name: str = ""
    parent: int | None = None

    @property
    def can_stop(self) -> bool:
        """Whether the process, which must have the lock file open, executes a run that this user can stop safely."""
        if sys.platform == "win32" or self.name != ENGINE:
            return False
        handles = Path(f"/proc/{self.pid}/fd")
        try:
            os.kill(self.pid, 0)
            return not handles.is_dir() or any(_is_same(handle, self.file) for handle in handles.iterdir())
        except OSError:  # the process belongs to another user
            return False

    def stop(self) -> bool:
        """Request a safe stop of the run; return False if the process no longer owns the port or cannot be reached."""
        if _owner_of(self.file) != self or not self.can_stop:
            return False
        with suppress(OSError):
            os.kill(self.pid, signal.SIGTERM)
            return True
        return False


#: Keys of a lock file; another version of the program may write more.
_OWNER_KEYS = tuple(field.name for field in fields(PortOwner) if field.name != "file")


def find_station_owner(path: Path | None, done: Callable[[Path | None, PortOwner | None], None]) -> None:
    """Find the process that uses a device of a station file, in a thread that calls `done(path, owner)`.

    The name of a host may take seconds to resolve. A virtual bench and an invalid station have no owner.
    """

    def find() -> None:
        owner = None
        try:
            with suppress(CalstationError, OSError):  # the pages show why the station is unusable
                _, station = load_station(path)
                owner = None if station.bench is not None else station_owner(station)
        finally:
            done(path, owner)

    threading.Thread(target=find, daemon=True).start()


@contextmanager
def lock_ports(ports: Iterable[str]) -> Iterator[None]:
    """Lock ports; all names of a port share one lock. Raises PortLockError with the process that uses a port."""
    devices = {device: port for port in ports for device in _devices(port)}
    with ExitStack() as stack:
        for device in sorted(devices):  # the fixed order prevents two processes from waiting for each other
            stack.enter_context(_locked(device, devices[device]))
        yield


@contextmanager
def _locked(device: str, port: str) -> Iterator[None]:
    path = _lock_file(device)
    try:
        handle = _open(path)
    except OSError as exc:
        raise PortLockError("connection.lock_failed", port=port, path=str(path), cause=os_reason(exc)) from exc
    try:
        if not acquire_lock(handle, _LOCK_TIMEOUT):
            raise _in_use_fault(port, path)
        parent = multiprocessing.parent_process()
        owner = {
            "pid": os.getpid(),
            "user": computer_user(),
            "since": datetime.now(UTC).isoformat(timespec="seconds"),
            "name": multiprocessing.current_process().name,
            "parent": None if parent is None else parent.pid,
        }
        os.ftruncate(handle, 0)
        os.lseek(handle, 0, os.SEEK_SET)
        os.write(handle, json.dumps(owner).encode())
        yield
    finally:
        os.close(handle)


def _open(path: Path) -> int:
    """Open a lock file, which is created for all users of this computer if it does not exist."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with suppress(OSError):  # the folder may belong to another user
        path.parent.chmod(0o1777)
    flags = os.O_RDWR | getattr(os, "O_NOFOLLOW", 0)
    while True:
        with suppress(FileNotFoundError):
            return os.open(path, flags)
        with suppress(FileExistsError):
            handle = os.open(path, flags | os.O_CREAT | os.O_EXCL, 0o666)
            if sys.platform != "win32":
                os.fchmod(handle, 0o666)
            return handle


def _in_use_fault(port: str, path: Path) -> PortLockError:
    """Return the fault for a port in use, with the owner from the lock file."""
    owner = _read_owner(path)
    if owner is None:
        return PortLockError("connection.port_in_use_unknown", port=port)
    return PortLockError("connection.port_in_use", port=port, pid=owner.pid, user=owner.user, since=owner.since)


def station_owner(station: StationConfig) -> PortOwner | None:
    """Return the process that uses a device of a station, or None."""
    sections = (station.table, station.chamber, station.imu, *station.slots, *station.secondaries.values())
    ports = (section.port for section in sections if section is not None and section.port)
    files = {_lock_file(device): None for port in ports for device in _devices(port)}
    return next(filter(None, map(_owner_of, files)), None)


def _owner_of(path: Path) -> PortOwner | None:
    """Return the owner in a lock file, or None if no process keeps the file locked."""
    with suppress(OSError):  # the file does not exist
        return _read_owner(path) if is_locked(path) else None
    return None


def _read_owner(path: Path) -> PortOwner | None:
    try:
        content = parse_json(path.read_bytes())
        return PortOwner(path, **{key: content[key] for key in _OWNER_KEYS if key in content})
    except (OSError, ValueError, TypeError):
        return None


def _is_same(first: Path, second: Path) -> bool:
    try:
        return first.samefile(second)
    except OSError:  # closed, or not a file
        return False


def _devices(port: str) -> Iterator[str]:
    """Yield identifiers of the devices at a port, which are the same for all names of a device."""
    if "://" in port:
        yield from _addresses(port)
        return
    try:
        device = os.path.realpath(port_device(port, "imu"))
    except DeviceFaultError:  # the error is reported when the port is opened
        return
    usb = next((adapter.usb for adapter in list_serial_ports() if os.path.realpath(adapter.device) == device), None)
    if usb is not None:
        yield usb  # another adapter may get the device name when this adapter is unplugged
    elif sys.platform == "win32" or Path(device).exists():
        yield device


def _addresses(url: str) -> Iterator[str]:
    """Yield the addresses of ``host:port``, which are the same for all names of the host."""
    with suppress(ValueError):
        parts = urlsplit(url)
        host, number = parts.hostname, parts.port
        if host is None or number is None:
            return
        try:
            addresses = socket.getaddrinfo(host, number, type=socket.SOCK_STREAM)
        except OSError:
            yield f"{host}:{number}"
            return
        for *_, address in addresses:
            host_address = str(address[0]).partition("%")[0]
            yield f"{'loopback' if ipaddress.ip_address(host_address).is_loopback else host_address}:{number}"


def _lock_file(device: str) -> Path:
    return _folder() / f"{quote(device, safe='')}.lock"


def _folder() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("PROGRAMDATA", "C:\\ProgramData")) / "calstation" / "locks"
    return Path("/tmp/calstation-locks")  # the sticky bit keeps users from removing others' files
