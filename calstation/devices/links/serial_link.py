"""One serial link: opens any port that pyserial knows and turns its many exceptions into one."""

import select
from contextlib import suppress

import serial

from calstation.devices.links.serial_ports import found_ports, resolve
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.errors import ConfigurationError, DeviceFaultError

try:
    from termios import error as termios_error
except ImportError:  # no termios on Windows
    termios_error = OSError  # type: ignore[assignment, misc]

#: What pyserial raises: a closed pty gives plain OSError, a refused parity termios.error.
LINK_ERRORS = (serial.SerialException, OSError, termios_error)

_READ_SIZE = 65536


class PortLostError(DeviceFaultError):
    """An open port has gone, a pulled plug or a device that hung up; `reason` says no more than that."""

    def __init__(self, text: str, reason: str = "the port was lost") -> None:
        super().__init__(text)
        self.reason = reason


class SerialLink:
    """An open port. Not for use by two threads at once.

    Parameters
    ----------
    port : `/dev/...`, `COM3`, `usb:SERIALNUMBER`, `socket://host:port` or `rfc2217://host:port`
    settings : baud and so on; meaningless for sockets
    name : what messages call the device, e.g. "IMU"

    Raises
    ------
    ConfigurationError
        where no such port can exist or the settings do not fit it.
    DeviceFaultError
        where it cannot be opened.
    """

    def __init__(self, port: str, settings: SerialSettings, name: str) -> None:
        self.port = port
        self.name = name
        device = resolve(port, name)
        try:
            self._serial = _opened(device, settings)
        except ValueError as exc:
            raise ConfigurationError(f"{name}: port {port}: {exc}; correct the port's settings") from exc
        except LINK_ERRORS as exc:
            raise DeviceFaultError(
                f"{name}: port {port} cannot be opened ({_reason(exc)}); {_mend(port, exc)}"
            ) from exc
        try:
            self._fileno: int | None = self._serial.fileno()
        except (AttributeError, OSError, ValueError):
            self._fileno = None

    def read(self, wait: float) -> bytes:
        """Bytes that have come, waiting at most `wait` s for the first. Raises PortLostError."""
        try:
            if self._fileno is not None:
                ready, _, _ = select.select([self._fileno], [], [], wait)
                return bytes(self._serial.read(_READ_SIZE)) if ready else b""
            if self._serial.timeout != wait:
                self._serial.timeout = wait
            first = self._serial.read(1)
            return bytes(first + self._serial.read(self._serial.in_waiting)) if first else b""
        except LINK_ERRORS as exc:
            raise self._lost(exc) from exc

    def write(self, data: bytes) -> None:
        """Send bytes. Raises PortLostError."""
        try:
            self._serial.write(data)
        except LINK_ERRORS as exc:
            raise self._lost(exc) from exc

    def close(self) -> None:
        """Close the port; never raises."""
        # pyserial forgets a socket whose far end has gone, without closing it.
        held = getattr(self._serial, "_socket", None)
        with suppress(*LINK_ERRORS):
            self._serial.close()
        if held is not None:
            held.close()

    def _lost(self, exc: BaseException) -> PortLostError:
        return PortLostError(
            f"{self.name}: port {self.port} was lost ({_reason(exc)}); check cable and power",
            f"the port was lost: {_reason(exc)}",
        )


def _opened(device: str, settings: SerialSettings) -> serial.Serial:
    port = serial.serial_for_url(
        device,
        baudrate=settings.baud,
        bytesize=settings.data_bits,
        parity=settings.parity,
        stopbits=settings.stop_bits,
        timeout=0,
        write_timeout=settings.write_timeout_s,
        exclusive=True,  # two readers of one port would each get half of the bytes
    )
    try:
        port.parity = settings.parity  # a port that has none may take it at first and drop it silently
    except LINK_ERRORS:
        port.close()
        raise
    return port


def _reason(exc: BaseException) -> str:
    text = str(getattr(exc, "strerror", None) or exc)
    return text.rsplit("] ", 1)[-1].split(": '")[0].rstrip(".")


def _mend(port: str, exc: BaseException) -> str:
    if "://" in port:
        return "check that the device serves there and that the port in the station file is right"
    if "exclusively lock" in str(exc):
        return "another program uses it; close that program"
    if isinstance(exc, PermissionError) or "Permission" in str(exc):
        return "close other programs that use it and allow this user to use serial ports (group dialout)"
    found = ", ".join(p.device for p in found_ports()) or "none"
    return f"ports found: {found}; correct the port in the station file"
