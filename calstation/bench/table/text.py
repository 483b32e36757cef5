"""Controllers with text protocols, which carry out commands on the table's machine.

    ATL   lines end with CR and LF, every reply with the prompt ">"; JOG is answered only together with the next line
    ACL   lines end with LF; only questions are answered, a wrong command shows in *STB?
    $MN   $MNxxx,arguments*SS -> $ASxxx,OK,...*SS; SS is the 8-bit sum of what stands between head and asterisk

Angles in degrees, rates in °/s, accelerations in °/s². Axis 1 is the outer joint, axis 2 the inner one.
"""

import re
from collections.abc import Callable
from typing import Protocol

import numpy as np

from calstation.bench.table.machine import Fault, Power, Refusal, TableMachine

ENABLED, HOMED, MOVING, SETTLED, FAULTY, CLOSED, REMOTE = 1, 2, 4, 8, 16, 32, 64

#: Default rate and acceleration of a motion, rad/s and rad/s².
_RATE, _ACCELERATION = np.deg2rad(10.0), np.deg2rad(20.0)


class TextController(Protocol):
    """A controller on a serial line."""

    def feed(self, data: bytes) -> list[bytes]:
        """Take received bytes; returns one reply, possibly empty, for each completed line."""


class Axes:
    """The table's two joints as a controller without watchdog sees them, one by one.

    Parameters
    ----------
    machine : the controller's motion
    device_time, host_time : clocks, s
    reading_time : device time at which a polled position was taken, s
    """

    def __init__(
        self,
        machine: TableMachine,
        *,
        device_time: Callable[[], float],
        host_time: Callable[[], float],
        reading_time: Callable[[], float],
    ) -> None:
        machine.watchdog = 0.0
        self._machine = machine
        self._device_time, self._host_time, self._reading_time = device_time, host_time, reading_time
        self._wanted = [False, False]
        self.rates = [_RATE, _RATE]
        self.accelerations = [_ACCELERATION, _ACCELERATION]
        self.targets = [0.0, 0.0]

    def know_zero(self) -> None:
        """Treat the encoders as absolute."""
        self._machine.know_zero()

    def power(self, joint: int, on: bool) -> None:
        """Switch an axis; the machine is enabled once both are on."""
        self._wanted[joint] = on
        for word in (0x06, 0x07, 0x0F) if all(self._wanted) else (0x06,):
            self._control(word)

    def wanted(self, joint: int) -> bool:
        """Whether an axis was switched on."""
        return self._wanted[joint]

    def home(self) -> None:
        """Home both axes unless they are homed or moving."""
        if not self._machine.homed and self._device_time() >= self._machine.drive.end:
            self._machine.home(self._device_time())

    def move(self, joint: int) -> None:
        """Start an axis towards its target."""
        self._machine.move_joint(
            self._device_time(), joint, self.targets[joint], self.rates[joint], self.accelerations[joint]
        )

    def turn(self, joint: int, rate: float) -> None:
        """Turn an axis at a rate, rad/s, until it is stopped; a rate of 0 stops it."""
        if rate == 0.0:
            self.stop()
        else:
            self._machine.turn_joint(self._device_time(), joint, rate, self.accelerations[joint])

    def stop(self) -> None:
        """Both axes decelerate to rest."""
        self._machine.stop(self._device_time())

    def reset(self) -> None:
        """Clear a latched fault; the axes stay off."""
        self._wanted = [False, False]
        for word in (0x00, 0x80, 0x00):
            self._control(word)

    def state(self, joint: int) -> int:
        """Bits of an axis."""
        machine, time = self._machine, self._device_time()
        settled = machine.settled(time)
        told = {
            ENABLED: machine.power is Power.ENABLED,
            HOMED: machine.homed,
            MOVING: not settled,
            SETTLED: settled,
            FAULTY: machine.fault is not Fault.NONE,
            CLOSED: machine.interlock_closed,
            REMOTE: True,
        }
        return sum(bit for bit, is_set in told.items() if is_set)

    @property
    def fault(self) -> int:
        """Code of the latched fault; 0 without a fault."""
        return int(self._machine.fault)

    def position(self, joint: int) -> float:
        """Encoder angle, degrees."""
        return float(np.rad2deg(self._machine.positions(self._reading_time())[joint]))

    def speed(self, joint: int) -> float:
        """Rate, °/s."""
        return float(np.rad2deg(self._machine.drive.states(self._reading_time())[joint, 1]))

    def travel(self, joint: int) -> tuple[float, float]:
        """Ends of the travel, degrees."""
        limits = self._machine.limits
        return float(np.rad2deg(limits.low[joint])), float(np.rad2deg(limits.high[joint]))

    def fastest(self) -> tuple[float, float]:
        """Largest rate and acceleration, °/s and °/s²."""
        limits = self._machine.limits
        return float(np.rad2deg(limits.rate)), float(np.rad2deg(limits.acceleration))

    def _control(self, word: int) -> None:
        self._machine.control(word, self._device_time(), self._host_time())


class Atl:
    """Ideal Aerosmith's table language, as far as the bench implements it.

    Parameters
    ----------
    axes : the joints
    serial : serial number in the identification
    """

    def __init__(self, axes: Axes, serial: str) -> None:
        self._axes, self._serial = axes, serial
        self._pending = b""
        self._owed = b""

    def feed(self, data: bytes) -> list[bytes]:
        """See `TextController`."""
        lines, self._pending = _lines(self._pending + data)
        return [self._answer(line.strip().upper()) for line in lines]

    def _answer(self, line: str) -> bytes:
        try:
            words = self._obey(line)
        except (Refusal, ValueError):
            words = "?ERR"
        reply = self._owed + (f"{words}\r\n" if words else "").encode() + b">"
        self._owed = b""
        if "JOG" in line:
            self._owed, reply = reply, b""
        return reply

    def _obey(self, line: str) -> str:
        axes = self._axes
        if line == "IDN":
            return f"AERO 4000,{self._serial}"
        match = re.fullmatch(r"([12])([A-Z]{3})(.*)", line)
        if match is None:
            raise ValueError(line)
        joint, name, value = int(match[1]) - 1, match[2], match[3]
        if name == "STA":
            return f"{axes.state(joint)} {axes.fault}"
        if name == "PPO":
            return f"{axes.position(joint):.4f}"
        if name == "PVE":
            return f"{axes.speed(joint):.4f}"
        if name in ("ACL", "VEL", "MOV", "JOG"):
            number = float(np.deg2rad(float(value)))
            if name == "ACL":
                axes.accelerations[joint] = number
            elif name == "VEL":
                axes.rates[joint] = number
            elif name == "MOV":
                axes.targets[joint] = number
                axes.move(joint)
            else:
                axes.turn(joint, number)
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


class Acl:
    """Acutronic's command language, as far as the bench implements it.

    Parameters
    ----------
    axes : the joints
    serial : serial number in the identification
    """

    def __init__(self, axes: Axes, serial: str) -> None:
        self._axes, self._serial = axes, serial
        self._pending = b""
        self._modes = ["Off", "Off"]
        self._wrong = False
        axes.know_zero()

    def feed(self, data: bytes) -> list[bytes]:
        """See `TextController`."""
        lines, self._pending = _lines(self._pending + data)
        return [self._answer(line.strip()) for line in lines]

    def _answer(self, line: str) -> bytes:
        asked, _, rest = line.partition("?")
        if "?" in line:
            words = self._tell(asked.lower(), rest)
            self._wrong = self._wrong or words is None
            return b"" if words is None else f"{words}\n".encode()
        command, _, rest = line.partition(" ")
        try:
            self._obey(command.lower(), [part.strip() for part in rest.split(",")])
        except (Refusal, ValueError, IndexError):
            self._wrong = True
        return b""

    def _tell(self, name: str, rest: str) -> str | None:
        axes = self._axes
        if name == "*idn":
            return f"ACUTRONIC SCHWEIZ,ACU 2000,{self._serial},1.0"
        if name == "*stb":
            wrong, self._wrong = self._wrong, False
            return "65" if wrong or axes.fault else "0"
        if rest.strip() not in ("1", "2"):
            return None
        joint = int(rest) - 1
        if name == ":interlock":
            if axes.fault:
                return "Fault"
            return "Closed" if axes.state(joint) & ENABLED else "Open"
        low, high = axes.travel(joint)
        told = {
            ":mode": self._modes[joint],
            ":read:pos": f"{axes.position(joint):.5f}",
            ":read:rate": f"{axes.speed(joint):.5f}",
            ":limit:absolute": ",".join(f"{v:g}" for v in (*axes.fastest(), 1e4, low, high, 1e3)),
        }
        return told.get(name)

    def _obey(self, name: str, rest: list[str]) -> None:
        axes = self._axes
        if name == ":interlock:reset":
            axes.reset()
            self._modes = ["Off", "Off"]
            return
        if name in (":lim:acc", ":lim:rate"):
            joint, number = int(rest[1]) - 1, float(np.deg2rad(float(rest[2])))
            if rest[0].lower() not in ("pos", "rate"):
                raise ValueError(name)
            (axes.accelerations if name == ":lim:acc" else axes.rates)[joint] = number
            return
        joint = int(rest[0]) - 1
        if joint not in (0, 1):
            raise ValueError(name)
        if name in (":int:close", ":int:open"):
            axes.power(joint, name == ":int:close")
        elif name in (":mode:pos", ":mode:rate", ":mode:off"):
            self._modes[joint] = {"s": "Position", "e": "Rate", "f": "Off"}[name[-1]]
        elif name == ":dem:pos" and self._modes[joint] == "Position":
            axes.targets[joint] = float(np.deg2rad(float(rest[1])))
            axes.move(joint)
        elif name == ":dem:rate" and self._modes[joint] == "Rate":
            axes.turn(joint, float(np.deg2rad(float(rest[1]))))
        else:
            raise ValueError(name)


class Mn:
    """The language of $MN lines, as far as the bench implements it.

    Parameters
    ----------
    axes : the joints
    serial : serial number in the identification
    """

    def __init__(self, axes: Axes, serial: str) -> None:
        self._axes, self._serial = axes, serial
        self._pending = b""
        self._turns = [False, False]

    def feed(self, data: bytes) -> list[bytes]:
        """See `TextController`; a line with a wrong checksum gets no answer."""
        lines, self._pending = _lines(self._pending + data)
        return [self._answer(line) for line in lines]

    def _answer(self, line: str) -> bytes:
        match = re.fullmatch(r"\$MN(.*)\*([0-9A-F]{2})\s*", line)
        if match is None or sum(match[1].encode()) & 0xFF != int(match[2], 16):
            return b""
        name, *rest = match[1].split(",")
        try:
            words = f"{name},OK{self._obey(name, rest)}"
        except (Refusal, ValueError, IndexError):
            words = f"{name},ERR"
        return f"$AS{words}*{sum(words.encode()) & 0xFF:02X}\r\n".encode()

    def _obey(self, name: str, rest: list[str]) -> str:
        axes = self._axes
        if name == "CHK":
            return f",MN-2A,{self._serial}"
        if name == "STS":
            told = ",".join(f"{axes.position(j):.5f},{axes.speed(j):.5f}" for j in (0, 1))
            return f",{told},{axes.state(0):04X},{axes.fault}"
        if name in ("REM", "CLR"):
            if name == "CLR":
                axes.reset()
            return ""
        joint = int(rest[0]) - 1
        if joint not in (0, 1):
            raise ValueError(name)
        if name in ("ENB", "DIS"):
            axes.power(joint, name == "ENB")
        elif name == "HMZ":
            axes.home()
        elif name == "MOD":
            self._turns[joint] = ("POS", "VEL").index(rest[1]) == 1
        elif name == "POS":
            axes.targets[joint] = float(np.deg2rad(float(rest[1])))
        elif name == "VEL":
            axes.rates[joint] = float(np.deg2rad(float(rest[1])))
        elif name == "ACC":
            axes.accelerations[joint] = float(np.deg2rad(float(rest[1])))
        elif name == "RUN":
            if self._turns[joint]:
                axes.turn(joint, axes.rates[joint])
            else:
                axes.move(joint)
        elif name == "STP":
            axes.stop()
        else:
            raise ValueError(name)
        return ""


#: Controllers by the name of their language.
LANGUAGES: dict[str, Callable[[Axes, str], TextController]] = {"atl": Atl, "acl": Acl, "mn": Mn}


def _lines(data: bytes) -> tuple[list[str], bytes]:
    """Complete lines, and the bytes after the last of them."""
    *whole, rest = data.split(b"\n")
    return [line.decode("ascii", "replace") for line in whole], rest[-1000:]
