"""Drivers of chambers with lines of text or Modbus registers, which their profiles define."""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

from calstation.devices.codecs import quote_text
from calstation.devices.interfaces import Chamber, ChamberStatus, OtherModelError
from calstation.devices.links import ModbusLink, PortLostError, TextLink, UnexpectedReplyError, text_number
from calstation.devices.profiles import ChamberModbusSection, ChamberProfile, ChamberTextSection, Flag, SerialSettings
from calstation.errors import DeviceFaultError

T = TypeVar("T")


@contextmanager
def _chamber_errors() -> Iterator[None]:
    """Convert link errors, which are worded for a table, to errors of the chamber."""
    try:
        yield
    except DeviceFaultError as error:
        raise DeviceFaultError("chamber.link", reason=error.as_text) from error


def _on_new_connection(exchange: Callable[[], T]) -> T:
    """Repeat an exchange on a new connection if the connection was lost; a chamber may close it during a long soak."""
    try:
        return exchange()
    except PortLostError:
        return exchange()


def open_chamber(
    port: str, profile: ChamberProfile, serial: SerialSettings | None = None
) -> "TextChamber | ModbusChamber":
    """Open a chamber on its port and return its driver.

    Raises DeviceFaultError or ConfigurationError if the port cannot be opened.

    Parameters
    ----------
    port : `tcp://host:port`, or a serial port
    profile : profile of the chamber
    serial : settings of the serial port; None for those of the profile
    """
    return (TextChamber if profile.protocol == "text" else ModbusChamber)(port, profile, serial)


class TextChamber(Chamber):
    """Driver of a chamber with lines of text."""

    def __init__(self, port: str, profile: ChamberProfile, serial: SerialSettings | None = None) -> None:
        if not isinstance(profile.section, ChamberTextSection):
            raise TypeError(f"{profile.name} has protocol {profile.protocol!r}")
        self._profile, self._text = profile, profile.section
        with _chamber_errors():
            self._link = TextLink(port, self._text, serial or self._text.serial, "chamber")
        self._patterns = {name: re.compile(query.answer) for name, query in self._text.queries.items()}

    def identify(self) -> str:
        """Return the identity that the chamber reports, and send the queries that are sent only once."""
        with _chamber_errors():
            model = self._ask("identity")["model"]
        if self._profile.model not in model:
            raise OtherModelError("chamber.other_model", found=model, expected=self._profile.model)
        with _chamber_errors():
            for name in self._text.queries:
                if name not in ("identity", *self._text.polled):
                    self._ask(name)
        return model

    def status(self) -> ChamberStatus:
        """Poll the state of the chamber."""
        with _chamber_errors():
            answers = {name: self._ask(name) for name in self._text.polled}
            flags = self._text.flags
            alarm = self._flag(flags.alarm, answers)
            return ChamberStatus(
                air_c=text_number(answers["air"]["value"]),
                set_point_c=text_number(answers["set_point"]["value"]),
                running=bool(self._flag(flags.running, answers)),
                door_open=self._flag(flags.door, answers),
                alarm=self._alarm(flags.alarm, answers) if alarm else None,
            )

    def set_point(self, temperature_c: float) -> None:
        """Set the set point of the air temperature, °C."""
        self._send("set_point", temperature=f"{temperature_c:.{self._text.decimals}f}")

    def start(self) -> None:
        """Start controlling the temperature."""
        self._send("start")

    def stop(self) -> None:
        """Stop controlling the temperature."""
        self._send("stop")

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    @property
    def received(self) -> bytes:
        """Bytes received last."""
        return self._link.received

    def _send(self, command: str, **values: str) -> None:
        with _chamber_errors():
            for line in getattr(self._text.commands, command):
                _on_new_connection(partial(self._link.command, line.format(**values)))

    def _ask(self, name: str) -> dict[str, str]:
        query = self._text.queries[name]
        reply = _on_new_connection(partial(self._link.ask, query.send, self._patterns[name]))
        match = self._patterns[name].search(reply)
        if match is None:
            values = {"line": query.send, "answer": quote_text(reply), "query": name}
            raise UnexpectedReplyError("table.unexpected_answer", **values)
        return {group: value for group, value in match.groupdict().items() if value is not None}

    @staticmethod
    def _flag(flag: Flag | None, answers: Mapping[str, Mapping[str, str]]) -> bool | None:
        return None if flag is None else flag.is_set(answers[flag.query] if flag.query else {})

    def _alarm(self, flag: Flag | None, answers: Mapping[str, Mapping[str, str]]) -> str:
        value = "" if flag is None or flag.query is None else answers[flag.query].get(flag.group, "")
        return self._profile.alarm(value)


class ModbusChamber(Chamber):
    """Driver of a chamber with Modbus registers."""

    def __init__(self, port: str, profile: ChamberProfile, serial: SerialSettings | None = None) -> None:
        if not isinstance(profile.section, ChamberModbusSection):
            raise TypeError(f"{profile.name} has protocol {profile.protocol!r}")
        self._profile, self._modbus = profile, profile.section
        with _chamber_errors():
            self._link = ModbusLink(
                port, self._modbus.unit, self._modbus.timeout_s, serial or self._modbus.serial, "chamber"
            )

    def identify(self) -> str:
        """Compare the expected registers and return the model in the profile. Raises DeviceFaultError."""
        for name, expected in self._modbus.expected.items():
            value = self._read(name)
            if value != expected:
                raise DeviceFaultError("chamber.unlike_profile", register=name, found=value, expected=expected)
        return self._profile.model or self._profile.name

    def status(self) -> ChamberStatus:
        """Poll the state of the chamber."""
        names = ("air", "set_point", "running", "alarm", "door")
        value = {name: self._read(name) for name in names if name in self._modbus.registers}
        alarm = value.get("alarm", 0.0)
        return ChamberStatus(
            air_c=value["air"] if math.isfinite(value["air"]) else math.nan,
            set_point_c=value["set_point"],
            running=value.get("running", 1.0) != 0.0,
            door_open=value["door"] != 0.0 if "door" in value else None,
            alarm=self._profile.alarm(f"{alarm:g}") if alarm else None,
        )

    def set_point(self, temperature_c: float) -> None:
        """Set the set point of the air temperature, °C."""
        register = self._modbus.registers["set_point"]
        self._write("set_point", register.encode(temperature_c, "set_point"))

    def start(self) -> None:
        """Start controlling the temperature."""
        self._command("start")

    def stop(self) -> None:
        """Stop controlling the temperature."""
        self._command("stop")

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    @property
    def received(self) -> bytes:
        """Bytes received last."""
        return self._link.received

    def _read(self, name: str) -> float:
        register = self._modbus.registers[name]
        with _chamber_errors():
            return register.decode(self._link.read(register.address, register.count))

    def _write(self, name: str, words: list[int]) -> None:
        with _chamber_errors():
            self._link.write(self._modbus.registers[name].address, words)

    def _command(self, command: str) -> None:
        for writes in getattr(self._modbus.commands, command) or ():
            for name, raw in writes.items():
                self._write(name, self._modbus.registers[name].words_of(raw))
