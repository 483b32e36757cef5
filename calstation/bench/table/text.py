"""Controllers with text protocols for the table's state machine.

Angles are in degrees, rates in °/s, accelerations in °/s². Axis 1 is the outer joint, axis 2 the inner one.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from calstation.bench.table.axes import Axes, StateBit
from calstation.bench.table.machine import Refusal


class TextController(ABC):
    """A controller on a serial line whose requests end with LF; it ignores the next `ignored_requests` lines."""

    def __init__(self, serial: str) -> None:
        self._serial, self._pending = serial, b""
        self.ignored_requests = 0

    def new_parser(self) -> Callable[[bytes], list[bytes]]:
        """Return the parser of a connection."""
        return self.feed

    def feed(self, data: bytes) -> list[bytes]:
        """Process received bytes and return a reply, possibly empty, for each complete line."""
        *lines, rest = (self._pending + data).split(b"\n")
        self._pending = rest[-1000:]
        replies = [self._reply(line.decode("ascii", "replace").strip()) for line in lines]
        muted = min(self.ignored_requests, len(replies))
        self.ignored_requests -= muted
        return [b""] * muted + replies[muted:]

    @abstractmethod
    def _reply(self, line: str) -> bytes:
        """Execute a line and return the reply."""


def _joint(text: str) -> int:
    joint = int(text) - 1
    if joint not in (0, 1):
        raise ValueError(text)
    return joint


def _radians(text: str) -> float:
    return float(np.deg2rad(float(text)))


class Atl(TextController):
    """A subset of the table language of Ideal Aerosmith.

    Lines end with CR and LF, and replies with the prompt ">". The reply to JOG is sent together with the next reply.
    """

    def __init__(self, axes: Axes, serial: str) -> None:
        super().__init__(serial)
        self._axes, self._delayed = axes, b""

    def _reply(self, line: str) -> bytes:
        line = line.upper()
        try:
            words = self._execute(line)
        except (Refusal, ValueError):
            words = "?ERR"
        reply = self._delayed + (f"{words}\r\n" if words else "").encode() + b">"
        self._delayed = b""
        if "JOG" in line:
            self._delayed, reply = reply, b""
        return reply

    def _execute(self, line: str) -> str:
        axes = self._axes
        if line == "IDN":
            return f"AERO 4000,{self._serial}"
        match = re.fullmatch(r"([12])([A-Z]{3})(.*)", line)
        if match is None:
            raise ValueError(line)
        joint, name, value = int(match[1]) - 1, match[2], match[3]
        if name == "STA":
            return f"{axes.state()} {axes.fault}"
        if name == "PPO":
            return f"{axes.position(joint):.4f}"
        if name == "PVE":
            return f"{axes.speed(joint):.4f}"
        if name == "ACL":
            axes.accelerations[joint] = _radians(value)
        elif name == "VEL":
            axes.rates[joint] = _radians(value)
        elif name == "MOV":
            axes.targets[joint] = _radians(value)
            axes.move(joint)
        elif name == "JOG":
            axes.turn(joint, _radians(value))
        elif name == "SRV" and value in ("0", "1"):
            axes.power(joint, value == "1")
        elif name == "HOM" and not value:
            axes.home()
        elif name == "STO" and not value:
            axes.stop()
        elif name == "CLR" and not value:
            axes.reset()
        else:
            raise ValueError(line)
        return ""


class Acl(TextController):
    """A subset of the command language of Acutronic.

    Lines end with LF. Only queries have a reply; *STB? reports an invalid command.
    """

    def __init__(self, axes: Axes, serial: str) -> None:
        super().__init__(serial)
        self._axes, self._modes = axes, ["Off", "Off"]
        self._has_error = False
        axes.machine.set_zero()  # absolute encoders need no homing

    def _reply(self, line: str) -> bytes:
        name, question, arguments = line.partition("?")
        if question:
            words = self._value(name.lower(), arguments)
            self._has_error = self._has_error or words is None
            return b"" if words is None else f"{words}\n".encode()
        command, _, arguments = line.partition(" ")
        try:
            self._execute(command.lower(), [part.strip() for part in arguments.split(",")])
        except (Refusal, ValueError, IndexError):
            self._has_error = True
        return b""

    def _value(self, name: str, arguments: str) -> str | None:
        axes = self._axes
        if name == "*idn":
            return f"ACUTRONIC SCHWEIZ,ACU 2000,{self._serial},1.0"
        if name == "*stb":
            has_error, self._has_error = self._has_error, False
            return "65" if has_error or axes.fault else "0"
        if arguments.strip() not in ("1", "2"):
            return None
        joint = int(arguments) - 1
        if name == ":interlock":
            if axes.fault:
                return "Fault"
            return "Closed" if axes.state() & StateBit.ENABLED else "Open"
        limits = axes.machine.limits
        fastest_and_ends = np.rad2deg([limits.rate, limits.acceleration, limits.low[joint], limits.high[joint]])
        rate, acceleration, low, high = fastest_and_ends.tolist()
        values = {
            ":mode": self._modes[joint],
            ":read:pos": f"{axes.position(joint):.5f}",
            ":read:rate": f"{axes.speed(joint):.5f}",
            ":limit:absolute": ",".join(f"{v:g}" for v in (rate, acceleration, 1e4, low, high, 1e3)),
        }
        return values.get(name)

    def _execute(self, name: str, arguments: list[str]) -> None:
        axes = self._axes
        if name == ":interlock:reset":
            axes.reset()
            self._modes = ["Off", "Off"]
            return
        if name in (":lim:acc", ":lim:rate"):
            joint, number = int(arguments[1]) - 1, _radians(arguments[2])
            if arguments[0].lower() not in ("pos", "rate"):
                raise ValueError(name)
            (axes.accelerations if name == ":lim:acc" else axes.rates)[joint] = number
            return
        joint = _joint(arguments[0])
        if name in (":int:close", ":int:open"):
            axes.power(joint, name == ":int:close")
        elif name in (":mode:pos", ":mode:rate", ":mode:off"):
            self._modes[joint] = {"s": "Position", "e": "Rate", "f": "Off"}[name[-1]]
        elif name == ":dem:pos" and self._modes[joint] == "Position":
            axes.targets[joint] = _radians(arguments[1])
            axes.move(joint)
        elif name == ":dem:rate" and self._modes[joint] == "Rate":
            axes.turn(joint, _radians(arguments[1]))
        else:
            raise ValueError(name)


class Mn(TextController):
    """A subset of the $MN line protocol, $MNxxx,arguments*SS -> $ASxxx,OK,...*SS.

    SS is the 8-bit sum of the characters between header and asterisk. A line with a wrong checksum gets no reply.
    """

    def __init__(self, axes: Axes, serial: str) -> None:
        super().__init__(serial)
        self._axes, self._rate_mode = axes, [False, False]

    def _reply(self, line: str) -> bytes:
        match = re.fullmatch(r"\$MN(.*)\*([0-9A-F]{2})", line)
        if match is None or sum(match[1].encode()) & 0xFF != int(match[2], 16):
            return b""
        name, *arguments = match[1].split(",")
        try:
            words = f"{name},OK{self._execute(name, arguments)}"
        except (Refusal, ValueError, IndexError):
            words = f"{name},ERR"
        return f"$AS{words}*{sum(words.encode()) & 0xFF:02X}\r\n".encode()

    def _execute(self, name: str, arguments: list[str]) -> str:
        axes = self._axes
        if name == "CHK":
            return f",MN-2A,{self._serial}"
        if name == "STS":
            motion = ",".join(f"{axes.position(j):.5f},{axes.speed(j):.5f}" for j in (0, 1))
            return f",{motion},{axes.state():04X},{axes.fault}"
        if name == "CLR":
            axes.reset()
        if name in ("REM", "CLR"):
            return ""
        joint = _joint(arguments[0])
        if name in ("ENB", "DIS"):
            axes.power(joint, name == "ENB")
        elif name == "HMZ":
            axes.home()
        elif name == "MOD":
            self._rate_mode[joint] = ("POS", "VEL").index(arguments[1]) == 1
        elif name == "POS":
            axes.targets[joint] = _radians(arguments[1])
        elif name == "VEL":
            axes.rates[joint] = _radians(arguments[1])
        elif name == "ACC":
            axes.accelerations[joint] = _radians(arguments[1])
        elif name == "RUN":
            if self._rate_mode[joint]:
                axes.turn(joint, axes.rates[joint])
            else:
                axes.move(joint)
        elif name == "STP":
            axes.stop()
        else:
            raise ValueError(name)
        return ""


#: Controller classes by the name of their language.
LANGUAGES: dict[str, Callable[[Axes, str], TextController]] = {"atl": Atl, "acl": Acl, "mn": Mn}
