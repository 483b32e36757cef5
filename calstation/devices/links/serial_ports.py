"""The serial ports of this computer, and their names by the serial numbers of USB adapters."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from calstation.errors import DeviceFaultError

#: Prefix of a port named by its adapter: `usb:SERIALNUMBER`, or `usb:SERIALNUMBER/2` for its second port. If several
#: adapters have the same serial number, the location on the bus is appended: `usb:SERIALNUMBER@1-4`.
USB = "usb:"


@dataclass(frozen=True)
class SerialPortInfo:
    """A serial port listed by the system, e.g. `/dev/ttyUSB0` or `COM3`; unknown attributes are empty.

    usb : name of the adapter, which remains the same when its `device` changes; None if it has no unique serial number
        and its location is unknown
    """

    device: str
    description: str
    maker: str
    serial_number: str | None
    location: str
    usb: str | None


def list_serial_ports() -> tuple[SerialPortInfo, ...]:
    """Return all serial ports of this computer, USB adapters first."""
    listed = _listed()
    ports = []
    for p in listed:
        description = "" if p.description in (None, "n/a", p.name) else p.description
        usb = next(iter(_names(p, listed)), None)
        ports.append(
            SerialPortInfo(p.device, description, p.manufacturer or "", p.serial_number or None, p.location or "", usb)
        )
    return tuple(sorted(ports, key=lambda port: (port.usb is None, _natural(port.device))))


def port_device(port: str, device: str) -> str:
    """Return the current device of the adapter for a port `usb:...`, and any other port itself.

    Raises DeviceFaultError, with `device` as its source, unless exactly one such adapter is plugged in.
    """
    if not port.startswith(USB):
        return port
    listed = _listed()
    for p in listed:
        if port in _names(p, listed):
            return str(p.device)
    number = port.removeprefix(USB).partition("@")[0]
    ports = list_serial_ports()
    alike = [p for p in ports if p.serial_number in (number, number.rpartition("/")[0])]
    if alike:
        choice = [f"{p.usb} ({p.device})" if p.usb else p.device for p in alike]
        if len(alike) > 1 and "@" not in port:
            raise DeviceFaultError("link.ambiguous", device=device, port=port, count=len(alike), choice=choice)
        raise DeviceFaultError("link.not_plugged_in", device=device, port=port, choice=choice)
    adapters = [f"{f.usb} ({f.device})" for f in ports if f.usb]
    raise DeviceFaultError("link.no_adapter", device=device, port=port, found=adapters)


def _listed() -> list[ListPortInfo]:
    return sorted(list_ports.comports(), key=lambda p: (_natural(p.location or ""), _natural(p.device)))


def _names(port: ListPortInfo, listed: Sequence[ListPortInfo]) -> tuple[str, ...]:
    """Return the names of a port by its adapter, starting with the preferred name.

    A serial number of several adapters is no name, because its meaning would change when one of them is unplugged.
    """
    alike = [p for p in listed if p.serial_number and p.serial_number == port.serial_number]
    location = _location(port)
    ports = [p for p in alike if _location(p) == location]
    # All ports of an adapter appear and disappear together, so that their order identifies them.
    which = f"/{ports.index(port) + 1}" if len(ports) > 1 else ""
    names = []
    if ports and len(ports) == len(alike) and (location or len(ports) == 1):
        names.append(f"{USB}{port.serial_number}{which}")
    if ports and location:
        names.append(f"{USB}{port.serial_number}@{location}{which}")
    return tuple(names)


def _location(port: ListPortInfo) -> str:
    """Return the location of an adapter on the bus without its interface, or "" if it is unknown."""
    return (port.location or "").partition(":")[0]


def _natural(text: str) -> list[tuple[int, str]]:
    """Return a sort key that places ttyUSB10 after ttyUSB9."""
    return [(int(p), "") if p.isdecimal() else (-1, p) for p in re.split(r"(\d+)", text)]
