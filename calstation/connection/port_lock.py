"""One owner for every port of this computer: whoever opens a device holds its lock, which the system takes back
when he dies. A virtual bench has none: its ports are its run's own.

The locks are of this computer, for all its users and folders; they say nothing of another computer at the same table.
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

from calstation.config.request import computer_user
from calstation.devices.links.serial_ports import found_ports, resolve
from calstation.errors import DeviceFaultError
from calstation.records.locked import take

#: What another that is just closing is given to let go, s.
_WITHIN = 3.0


@contextmanager
def owned(ports: Iterable[str]) -> Iterator[None]:
    """Own ports, by any of their names. Raises DeviceFaultError naming who has one already."""
    places = {place: port for port in ports for place in _places(port)}
    with ExitStack() as stack:
        for place in sorted(places):  # in one order, so that no two wait for each other
            stack.enter_context(_owned(place, places[place]))
        yield


@contextmanager
def _owned(place: str, port: str) -> Iterator[None]:
    path = _folder() / f"{quote(place, safe='')}.lock"
    try:
        handle = _open(path)
    except OSError as exc:
        raise DeviceFaultError(
            f"port {port}: its lock {path} cannot be opened ({exc.strerror or exc}); make the folder writable"
        ) from exc
    try:
        if not take(handle, _WITHIN):
            raise DeviceFaultError(
                f"port {port} is in use by {_holder(handle)}; wait for its end, or end it there"
            )
        who = {
            "pid": os.getpid(),
            "user": computer_user(),
            "since": f"{datetime.now(UTC).astimezone():%Y-%m-%d %H:%M:%S}",
        }
        os.ftruncate(handle, 0)
        os.lseek(handle, 0, os.SEEK_SET)
        os.write(handle, json.dumps(who).encode())
        yield
    finally:
        os.close(handle)


def _open(path: Path) -> int:
    """The file of a lock, made where it is missing, for every user of this computer."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with suppress(OSError):  # another user's folder already
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


def _holder(handle: int) -> str:
    """Who holds the lock, as he has written it."""
    os.lseek(handle, 0, os.SEEK_SET)
    try:
        who = json.loads(os.read(handle, 4096))
        return f"another calstation (process {who['pid']} of {who['user']}, since {who['since']})"
    except (ValueError, KeyError, TypeError):
        return "another calstation"


def _places(port: str) -> Iterator[str]:
    """What a port's name leads to, the same for all names of one place; nothing where it leads nowhere."""
    if "://" in port:
        yield from _addresses(port)
        return
    try:
        device = os.path.realpath(resolve(port, "port"))
    except DeviceFaultError:  # told when it is opened
        return
    usb = next((found.usb for found in found_ports() if os.path.realpath(found.device) == device), None)
    if usb is not None:
        yield usb  # a device's name may go to another adapter when this one is pulled out
    elif sys.platform == "win32" or Path(device).exists():
        yield device


def _addresses(url: str) -> Iterator[str]:
    """Every address of host:port, so that two names of one host are alike."""
    with suppress(ValueError):
        parts = urlsplit(url)
        host, number = parts.hostname, parts.port
        if host is None or number is None:
            return
        try:
            found = socket.getaddrinfo(host, number, type=socket.SOCK_STREAM)
        except OSError:
            yield f"{host}:{number}"
            return
        for *_, address in found:
            plain = str(address[0]).partition("%")[0]
            yield f"{'loopback' if ipaddress.ip_address(plain).is_loopback else plain}:{number}"


def _folder() -> Path:
    """Where the locks are: the same for every user."""
    if sys.platform == "win32":
        return Path(os.environ.get("PROGRAMDATA", "C:\\ProgramData")) / "calstation" / "locks"
    return Path("/tmp/calstation-locks")  # sticky: nobody else takes a file away
