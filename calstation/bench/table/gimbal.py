"""The controller of the virtual three-axis gimbal, with a text protocol for the table's state machine and watchdog.

Angles are in degrees, rates in °/s. Lines end with LF. Every reply is one line; the reply to a refused command is "?".
"""

import numpy as np

from calstation.bench.table.axes import state_bits
from calstation.bench.table.machine import Clocks, Fault, NotPermitted, OutOfRange, Power, Refusal, TableMachine
from calstation.bench.table.text import TextController
from calstation.bench.truth import EncoderTruth, GimbalStream, TableDrive
from calstation.physics import FloatArray

MODEL = "VG-3"


class GimbalDrive(TableDrive):
    """The drive of the gimbal; homing and stopping act on all joints."""

    def __init__(self, stream: GimbalStream) -> None:
        super().__init__(EncoderTruth(0.0, 0.0, (0.0, 0.0), 0.0))
        self.stream = stream

    @property
    def end(self) -> float:
        """Time at which the motion ends, s."""
        return self.stream.end

    @property
    def settled(self) -> float:
        """Time from which the joints are at rest, s."""
        return self.stream.end

    def move(
        self, time: float, targets: tuple[float, float], rates: tuple[float, float], accelerations: tuple[float, float]
    ) -> None:
        """Move all joints to zero and lock them."""
        self.stream.command_home(rates[0])

    def stop(self, time: float, decelerations: tuple[float, float]) -> None:
        """Decelerate to rest and lock the joints."""
        self.stream.stop()


class GimbalController(TextController):
    """The controller with the gimbal's commands.

    IDN returns model and serial number. ENA and DIS switch the axes on and off. LCK locks the joints and averages the
    gyro bias, and STB starts stabilisation. TRN,axis,angle,rate turns about a body axis, HOM moves to zero and locks
    the joints, STP stops, CLR resets, and WDG feeds the watchdog. STS returns angles, rates, state bits, fault and
    watchdog timeout (s).
    """

    def __init__(self, machine: TableMachine, stream: GimbalStream, clocks: Clocks, serial: str, travel: float) -> None:
        super().__init__(serial)
        self._machine, self._stream, self._clocks, self._travel = machine, stream, clocks, travel

    def _reply(self, line: str) -> bytes:
        name, *arguments = line.upper().split(",")
        try:
            return f"{name},{self._execute(name, arguments)}\n".encode()
        except (Refusal, ValueError, IndexError):
            return b"?\n"

    def _execute(self, name: str, arguments: list[str]) -> str:
        machine, device, host = self._machine, self._clocks.device(), self._clocks.host()
        if name == "IDN":
            return f"{MODEL},{self._serial}"
        if name == "STS":
            return self._status(device)
        if name == "WDG":
            machine.feed(host)
        elif name in ("ENA", "DIS", "CLR"):
            words = {"ENA": (0x06, 0x07, 0x0F), "DIS": (0x06,), "CLR": (0x00, 0x80, 0x00)}[name]
            for word in words:
                machine.control(word, device, host)
        elif name == "HOM":
            machine.home(device)
        elif name == "STP":
            machine.stop(device)
        elif name in ("LCK", "STB"):
            self._check_permitted()
            (self._stream.lock_and_average_bias if name == "LCK" else self._stream.stabilise)()
        elif name == "TRN":
            self._check_permitted()
            self._turn("XYZ".index(arguments[0]), *(float(np.deg2rad(float(text))) for text in arguments[1:3]))
        else:
            raise ValueError(name)
        return "OK"

    def _check_permitted(self) -> None:
        machine = self._machine
        is_ready = machine.power is Power.ENABLED and machine.fault is Fault.NONE and machine.homed
        if not is_ready or self._clocks.device() < self._stream.end:
            raise NotPermitted

    def _turn(self, axis: int, angle: float, rate: float) -> None:
        if self._machine.jammed:  # the controller does not detect the jam
            return
        if not self._stream.is_stabilised:
            raise NotPermitted
        target = self._stream.joints[axis] + angle
        if abs(target) > self._travel or not 0.0 < rate <= self._machine.limits.rate:
            raise OutOfRange
        self._stream.command_turn(axis, angle, rate)

    def _status(self, device: float) -> str:
        machine = self._machine
        angles, rates = self._stream.readings
        state = f"{int(state_bits(machine, device))},{int(machine.fault)},{machine.watchdog:g}"
        return ",".join([_text(angles), _text(rates), state])


def _text(values: FloatArray) -> str:
    return ",".join(f"{float(v):.6f}" for v in np.rad2deg(values))
