"""Looks for serial ports beside the window, which must not wait for the system's list."""

from collections.abc import Callable

from calstation.devices.links.serial_ports import FoundPort, found_ports

__all__ = ["FoundPort", "discover"]


def discover(tell: Callable[..., None]) -> tuple[FoundPort, ...]:
    """Work for the workshop: the serial ports of this computer, USB adapters first."""
    ports = found_ports()
    tell(1.0)
    return ports
