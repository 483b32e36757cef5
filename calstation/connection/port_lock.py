"""Locks on the ports of this computer, which ensure that only one process at a time uses a device.

The operating system releases a lock when its process ends. The locks apply to all users and folders of this computer,
but not to other computers at the same table. A virtual bench needs no locks, because only its run uses its ports.
"""

import ipaddress
import json
import os
import socket
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import quote, urlsplit

from calstation.config import computer_user
from calstation.devices.links import list_serial_ports, port_device
from calstation.errors import DeviceFaultError
from calstation.messages import os_reason
from calstation.parsing import parse_json
from calstation.records import acquire_lock

#: Host time to wait for a process that is ending to release its lock, s.
_LOCK_TIMEOUT = 3.0


@contextmanager
def lock_ports(ports: Iterable[str]) -> Iterator[None]:
    """Lock ports, given by any of their names. Raises DeviceFaultError, which names the process that uses a port."""
    devices = {device: port for port in ports for device in _devices(port)}
    with ExitStack() as stack:
        for device in sorted(devices):  # the fixed order prevents two processes from waiting for each other
            stack.enter_context(_locked(device, devices[device]))
        yield


@contextmanager
def _locked(device: str, port: str) -> Iterator[None]:
    path = _folder() / f"{quote(device, safe='')}.lock"
    try:
        handle = _open(path)
    except OSError as exc:
        raise DeviceFaultError("connection.lock_failed", port=port, path=str(path), cause=os_reason(exc)) from exc
    try:
        if not acquire_lock(handle, _LOCK_TIMEOUT):
            raise _in_use_fault(port, handle)
        owner = {"pid": os.getpid(), "user": computer_user(), "since": datetime.now(UTC).isoformat(timespec="seconds")}
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


def _in_use_fault(port: str, handle: int) -> DeviceFaultError:
    """Return the fault for a port in use, with the owner from the lock file."""
    os.lseek(handle, 0, os.SEEK_SET)
    try:
        owner = parse_json(os.read(handle, 4096))
        pid, user, since = owner["pid"], owner["user"], owner["since"]
    except (ValueError, KeyError, TypeError):
        return DeviceFaultError("connection.port_in_use_unknown", port=port)
    return DeviceFaultError("connection.port_in_use", port=port, pid=pid, user=user, since=since)


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


def _folder() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("PROGRAMDATA", "C:\\ProgramData")) / "calstation" / "locks"
    return Path("/tmp/calstation-locks")  # the sticky bit keeps users from removing others' files
