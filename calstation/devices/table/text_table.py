"""Drivers of two-axis tables (ATL, ACL, $MN...*SS) and gimbals whose text commands are defined in their profiles."""

import re
from dataclasses import replace

import numpy as np

from calstation.devices.codecs import quote_text
from calstation.devices.interfaces import (
    LOCAL_CONTROL,
    UNKNOWN_FAULT,
    Gimbal,
    OtherModelError,
    Table,
    TableIdentity,
    TableStatus,
)
from calstation.devices.links import TextLink, UnexpectedReplyError, text_number
from calstation.devices.profiles import JOINTS, Flag, GimbalSection, SerialSettings, TableProfile, TextSection
from calstation.errors import ConfigurationError
from calstation.estimation.common import snap_angles
from calstation.physics import FloatArray, JointLimits

#: Pattern groups in the replies to each query, with one reply for both axes or one for each axis.
Answers = dict[str, list[dict[str, str]]]


class TextTable(Table):
    """Driver of a table on a serial port or `tcp://host:port`. Moves are absolute, and homing is not repeated."""

    def __init__(self, port: str, profile: TableProfile, serial: SerialSettings | None = None) -> None:
        self._profile, self._text = profile, profile.section_of(TextSection)
        self._link = TextLink(port, self._text, serial or self._text.serial)
        self._patterns = {name: re.compile(query.answer) for name, query in self._text.queries.items()}
        self._limits = profile.geometry().limits
        self._resting_polls = 0
        self._angles: FloatArray | None = None

    def identify(self) -> TableIdentity:
        """Return the model and serial number. Raises OtherModelError if another model replies."""
        (reply,) = self._ask("identity")
        groups = self._read("identity", reply)
        identity = TableIdentity(groups["model"], groups.get("serial") or "")
        if self._profile.model not in identity.model:
            raise OtherModelError("table.other_model", found=identity.model, expected=self._profile.model)
        return identity

    def status(self) -> TableStatus:
        """Poll the state of the table."""
        answers = self._poll()
        angles, rates = (_joints_of(answers[name], self._text.joint_names) for name in ("position", "rate"))
        at_rest = bool(np.all(np.abs(rates) < self._text.rest_rate_dps))
        moving = self._any_flag("moving", answers, otherwise=not at_rest)
        limits = self._travel(answers)
        return TableStatus(
            angles=snap_angles(np.deg2rad(angles)),
            rates=np.deg2rad(rates),
            enabled=self._all_flags("enabled", answers),
            homed=self._all_flags("homed", answers),
            moving=moving,
            settled=self._all_flags("settled", answers, otherwise=self._is_settled(angles, moving)),
            fault=self._fault(answers),
            interlock_closed=self._all_flags("interlock", answers, otherwise=True),
            watchdog=self._watchdog(answers),
            limits=limits,
        )

    def enable(self) -> None:
        """Switch both axes on."""
        self._send("enable")

    def disable(self) -> None:
        """Switch both axes off."""
        self._send("disable")

    def home(self) -> None:
        """Start homing; a lost reply is a fault and never causes a second homing."""
        if not self._text.commands.home:
            raise ConfigurationError("table.no_home_command")
        self._send("home", repeat=False)

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        """Start moving both joints to absolute angles; see `interfaces.Table`."""
        self._resting_polls = 0
        self._send("move", angle=(outer, inner), rate=(rate, rate), acceleration=(acceleration, acceleration))

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        """Rotate both joints at these rates until they are stopped; see `interfaces.Table`."""
        if not self._text.commands.rate:
            raise ConfigurationError("table.no_rate_command")
        self._profile.check_continuous_rotation(self.status().watchdog, (outer, inner), acceleration)
        self._resting_polls = 0
        self._send("rate", rate=(outer, inner), acceleration=(acceleration, acceleration))

    def stop(self) -> None:
        """Decelerate to rest."""
        self._send("stop")

    def reset_fault(self) -> None:
        """Clear a latched fault."""
        self._send("reset")

    def heartbeat(self) -> None:
        """Feed the table's watchdog if it has one."""
        self._send("heartbeat")

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    @property
    def received(self) -> bytes:
        """Bytes received last."""
        return self._link.received

    def _send(self, command: str, repeat: bool = True, **values: tuple[float, float]) -> None:
        """Send the lines of a command, those with {axis} once for each axis; values are in rad, rad/s and rad/s²."""
        lines: list[str] = getattr(self._text.commands, command)
        numbers = {name: [self._number(float(np.rad2deg(v))) for v in both] for name, both in values.items()}
        named = {f"{j}_{name}": both[i] for name, both in numbers.items() for i, j in enumerate(JOINTS)}
        for line in lines:
            for joint, axis in enumerate(self._text.axes if "{axis}" in line else [""]):
                axis_numbers = {name: both[joint] for name, both in numbers.items()}
                self._link.command(line.format(axis=axis, **axis_numbers, **named), repeat)

    def _number(self, value: float) -> str:
        text = f"{value:.{self._text.decimals}f}"
        return text.removeprefix("-") if float(text) == 0.0 else text

    def _poll(self) -> Answers:
        """Send all queries except the identity, the angle query in the middle; equal lines are sent only once."""
        queries = self._text.queries
        sends = list(dict.fromkeys(query.send for name, query in queries.items() if name != "identity"))
        angles = queries["position"].send
        sends.remove(angles)
        sends.insert(len(sends) // 2, angles)
        replies: dict[str, list[str]] = {}
        answers: Answers = {}
        for send in sends:
            for name, query in queries.items():
                if query.send == send and name != "identity":
                    if send not in replies:
                        replies[send] = self._ask(name)
                    answers[name] = [self._read(name, reply) for reply in replies[send]]
        return answers

    def _ask(self, name: str) -> list[str]:
        """Return the replies to a query, one for each axis if its line has {axis}. Raises DeviceFaultError."""
        query = self._text.queries[name]
        replies = []
        for axis in self._text.axes if "{axis}" in query.send else [""]:
            replies.append(self._link.ask(query.send.format(axis=axis), answer=self._patterns[name]))
            self._read(name, replies[-1])
        return replies

    def _read(self, name: str, reply: str) -> dict[str, str]:
        match = self._patterns[name].search(reply)
        if match is None:
            line, answer = self._text.queries[name].send, quote_text(reply)
            raise UnexpectedReplyError("table.unexpected_answer", line=line, answer=answer, query=name)
        return {group: value for group, value in match.groupdict().items() if value is not None}

    def _fault(self, answers: Answers) -> str | None:
        """Return the latched fault, or another reason why the table does not accept commands, or None."""
        if self._any_flag("fault", answers):
            codes = [
                groups["fault"]
                for name in self._text.queries
                for groups in answers.get(name, ())
                if groups.get("fault") not in (None, "0")
            ]
            return self._profile.faults.get(codes[0], f"code {codes[0]}") if codes else UNKNOWN_FAULT
        if not self._all_flags("remote", answers, otherwise=True):
            return LOCAL_CONTROL
        return None

    def _watchdog(self, answers: Answers) -> float:
        if "watchdog" not in self._text.queries:
            return float("inf")
        return min(text_number(groups["value"]) for groups in answers["watchdog"])

    def _travel(self, answers: Answers) -> JointLimits:
        if "limits" not in answers:
            return self._limits
        low, high = (
            [float(np.deg2rad(text_number(groups[end]))) for groups in answers["limits"]] for end in ("low", "high")
        )
        return JointLimits((low[0], low[-1]), (high[0], high[-1]), self._limits.rate, self._limits.acceleration)

    def _is_settled(self, angles: FloatArray, moving: bool) -> bool:
        is_near = self._angles is not None and bool(np.all(np.abs(angles - self._angles) <= self._text.settled_deg))
        self._resting_polls = self._resting_polls + 1 if is_near and not moving else 0
        self._angles = angles
        return self._resting_polls >= self._text.settled_polls

    def _all_flags(self, name: str, answers: Answers, otherwise: bool = False) -> bool:
        return all(self._flags(name, answers) or [otherwise])

    def _any_flag(self, name: str, answers: Answers, otherwise: bool = False) -> bool:
        return any(self._flags(name, answers) or [otherwise])

    def _flags(self, name: str, answers: Answers) -> list[bool]:
        """Return the value of a flag for each reply; an empty list if the profile does not define the flag."""
        flag: Flag | None = getattr(self._text.flags, name)
        if flag is None:
            return []
        return [flag.is_set(groups) for groups in answers[flag.query]] if flag.query else [flag.is_set({})]


class GimbalTable(TextTable, Gimbal):
    """Driver of a gimbal on a serial port or `tcp://host:port`, which executes turns instead of moves."""

    def __init__(self, port: str, profile: TableProfile, serial: SerialSettings | None = None) -> None:
        super().__init__(port, profile, serial)
        self._section = profile.section_of(GimbalSection)

    def status(self) -> TableStatus:
        """Poll the state of the gimbal; `angles` and `rates`, which belong to a two-axis table, are NaN."""
        status = super().status()
        unknown = np.full(2, np.nan)
        return replace(status, angles=unknown, rates=unknown, joints=status.angles, joint_rates=status.rates)

    def home(self) -> None:
        """Return to zero; unlike the homing of a table, this may be repeated."""
        self._send("home")

    def lock(self) -> None:
        """Lock the joints and start to average the gyro output, which gives the gyro bias."""
        self._send("lock")

    def stabilise(self) -> None:
        """Hold the unit at rest in space."""
        self._send("stabilise")

    def turn(self, axis: int, angle: float, rate: float) -> None:
        """Start a turn; a lost reply is a fault and never causes a second turn."""
        self._resting_polls = 0
        values = {"angle": self._number(float(np.rad2deg(angle))), "rate": self._number(float(np.rad2deg(rate)))}
        for line in self._section.commands.turn:
            self._link.command(line.format(axis=self._section.axes[axis], **values), repeat=False)

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        """Raise ConfigurationError, because a gimbal only executes turns."""
        raise ConfigurationError("table.gimbal_cannot_move", profile=self._profile.name)

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        """Raise ConfigurationError, because a gimbal only executes turns."""
        self.move(outer, inner, 0.0, acceleration)


def _joints_of(answers: list[dict[str, str]], joints: tuple[str, ...]) -> FloatArray:
    """Return the value of each joint, degrees, from one reply for all joints or from one reply for each joint."""
    if len(answers) == 1:
        return np.array([text_number(answers[0][joint]) for joint in joints])
    return np.array([text_number(groups["value"]) for groups in answers])
