"""The serial ports of this computer, and the one that a USB adapter's serial number means today."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from calstation.errors import DeviceFaultError

#: Begins a port that is named by its adapter: `usb:SERIALNUMBER`, `usb:SERIALNUMBER/2` for its second port; of several
#: adapters with the same number `usb:SERIALNUMBER@1-4`, by the place on the bus where it is plugged in.
USB = "usb:"


@dataclass(frozen=True)
class FoundPort:
    """A serial port as the system lists it.

    Attributes
    ----------
    device : what the system calls it now, e.g. `/dev/ttyUSB0` or `COM3`
    description, maker : as the adapter tells, "" where it tells nothing
    serial_number : the USB adapter's own, None where it has none
    location : where it is plugged in, "" where not known
    usb : the name that follows the adapter to whatever `device` it gets; None where it has no serial number, or the
        same as others and no place is known
    """

    device: str
    description: str
    maker: str
    serial_number: str | None
    location: str
    usb: str | None


def found_ports() -> tuple[FoundPort, ...]:
    """All serial ports of this computer, those of USB adapters first."""
    listed = _listed()
    ports = []
    for p in listed:
        told = "" if p.description in (None, "n/a", p.name) else p.description
        usb = next(iter(_names(p, listed)), None)
        ports.append(
            FoundPort(p.device, told, p.manufacturer or "", p.serial_number or None, p.location or "", usb)
        )
    return tuple(sorted(ports, key=lambda port: (port.usb is None, _natural(port.device))))


def resolve(port: str, name: str) -> str:
    """The port to open now: for `usb:...` the device that the adapter has at this moment, else `port` itself.

    Raises DeviceFaultError, beginning with `name`, where no such adapter is plugged in or several are.
    """
    if not port.startswith(USB):
        return port
    listed = _listed()
    for p in listed:
        if port in _names(p, listed):
            return str(p.device)
    number = port.removeprefix(USB).partition("@")[0]
    ports = found_ports()
    alike = [p for p in ports if p.serial_number in (number, number.rpartition("/")[0])]
    if alike:
        choice = " or ".join(f"{p.usb} ({p.device})" if p.usb else p.device for p in alike)
        means = f"means {len(alike)} ports" if len(alike) > 1 and "@" not in port else "is not plugged in"
        raise DeviceFaultError(f"{name}: port {port} {means}; name one of them: {choice}")
    known = ", ".join(f"{f.usb} ({f.device})" for f in ports if f.usb) or "none"
    raise DeviceFaultError(
        f"{name}: port {port}: no USB adapter with this serial number is plugged in; plug it in, or correct"
        f" the port in the station file; adapters found: {known}"
    )


def _listed() -> list[ListPortInfo]:
    return sorted(list_ports.comports(), key=lambda p: (_natural(p.location or ""), _natural(p.device)))


def _names(port: ListPortInfo, listed: Sequence[ListPortInfo]) -> tuple[str, ...]:
    """What a port may be called by its adapter, the name to prefer first.

    A number that several adapters have names none of them: pulled out, the first would hand its name to the second.
    """
    alike = [p for p in listed if p.serial_number and p.serial_number == port.serial_number]
    place = _place(port)
    own = [p for p in alike if _place(p) == place]
    # Ports of one adapter come and go together, so that their order says which is which.
    which = f"/{own.index(port) + 1}" if len(own) > 1 else ""
    names = []
    if own and len(own) == len(alike) and (place or len(own) == 1):
        names.append(f"{USB}{port.serial_number}{which}")
    if own and place:
        names.append(f"{USB}{port.serial_number}@{place}{which}")
    return tuple(names)


def _place(port: ListPortInfo) -> str:
    """Where on the bus an adapter is plugged in, "" where not known: what stands before its interface."""
    return (port.location or "").partition(":")[0]


def _natural(text: str) -> list[tuple[int, str]]:
    """Sorts ttyUSB10 behind ttyUSB9."""
    return [(int(p), "") if p.isdecimal() else (-1, p) for p in re.split(r"(\d+)", text)]
