"""The serial ports of this computer, and the one that a USB adapter's serial number means today."""

import re
from dataclasses import dataclass

from serial.tools import list_ports

from calstation.errors import DeviceFaultError

USB = "usb:"
"""Begins a port that is named by its adapter: `usb:SERIALNUMBER`, `usb:SERIALNUMBER/2` for its second port."""


@dataclass(frozen=True)
class FoundPort:
    """A serial port as the system lists it.

    Attributes
    ----------
    device : what the system calls it now, e.g. `/dev/ttyUSB0` or `COM3`
    description, maker : as the adapter tells, "" where it tells nothing
    serial_number : the USB adapter's own, None where it has none
    location : where it is plugged in, "" where not known
    usb : the name that follows the adapter to whatever `device` it gets, None where it has no serial number
    """

    device: str
    description: str
    maker: str
    serial_number: str | None
    location: str
    usb: str | None


def found_ports() -> tuple[FoundPort, ...]:
    """All serial ports of this computer, those of USB adapters first."""
    listed = sorted(list_ports.comports(), key=lambda p: (_natural(p.location or ""), _natural(p.device)))
    numbers = [p.serial_number for p in listed]
    ports = []
    for i, p in enumerate(listed):
        usb = None
        if p.serial_number:
            usb = f"{USB}{p.serial_number}"
            if numbers.count(p.serial_number) > 1:  # an adapter of several ports, or adapters numbered alike
                usb += f"/{numbers[: i + 1].count(p.serial_number)}"
        told = "" if p.description in (None, "n/a", p.name) else p.description
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
    ports = found_ports()
    for found in ports:
        if found.usb == port:
            return found.device
    alike = [f for f in ports if f.serial_number and f"{USB}{f.serial_number}" == port]
    if alike:
        choice = " or ".join(f"{f.usb} ({f.device})" for f in alike)
        raise DeviceFaultError(f"{name}: port {port} means {len(alike)} ports; name one of them: {choice}")
    known = ", ".join(f"{f.usb} ({f.device})" for f in ports if f.usb) or "none"
    raise DeviceFaultError(
        f"{name}: port {port}: no USB adapter with this serial number is plugged in; plug it in, or correct"
        f" the port in the station file; adapters found: {known}"
    )


def _natural(text: str) -> list[tuple[int, str]]:
    """Sorts ttyUSB10 behind ttyUSB9."""
    return [(int(p), "") if p.isdecimal() else (-1, p) for p in re.split(r"(\d+)", text)]
