"""Driver of a two-axis table that is commanded in lines of text, as its profile says (ATL, ACL, $MN...*SS)."""

import re
from collections.abc import Mapping

import numpy as np

from calstation.devices.codecs.packets import quoted_text
from calstation.devices.interfaces import LOCAL_CONTROL, UNTOLD, OtherModelError, TableIdentity, TableStatus
from calstation.devices.links.text_link import TextLink, UnlikeAnswerError
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.devices.profiles.table import TableProfile
from calstation.devices.profiles.table_registers import JOINTS
from calstation.devices.profiles.text import Flag
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.estimation.common.samples import snap_angles
from calstation.physics.arrays import FloatArray
from calstation.physics.table import JointLimits

#: Groups of each query's answers: one for both axes together, or one for each.
Answers = dict[str, list[dict[str, str]]]


class TextTable:
    """The table of a profile on a port.

    Moves are absolute, so a line sent again never adds to a motion; homing is never sent twice.

    Parameters
    ----------
    port : `tcp://host:port`, or a serial port
    profile : what the lines mean
    serial : settings of this place's port; the profile's where None
    """

    def __init__(self, port: str, profile: TableProfile, serial: SerialSettings | None = None) -> None:
        assert profile.text is not None
        self._profile, self._text = profile, profile.text
        self._link = TextLink(port, profile.text, serial or profile.text.serial)
        self._patterns = {name: re.compile(query.answer) for name, query in profile.text.queries.items()}
        self._limits = profile.geometry().limits
        self._still = 0
        self._angles: FloatArray | None = None

    def identify(self) -> TableIdentity:
        """Model and serial number; raises OtherModelError where another model answers."""
        (groups,) = self._query("identity")
        identity = TableIdentity(groups["model"], groups.get("serial") or "")
        if self._profile.model not in identity.model:
            raise OtherModelError(
                f"table: model '{identity.model}' answers, the profile is for '{self._profile.model}';"
                " choose the right table profile in the station file",
                identity.model,
                self._profile.model,
            )
        return identity

    def status(self) -> TableStatus:
        """Poll the table."""
        answers = self._poll()
        angles, rates = _joints_of(answers["position"]), _joints_of(answers["rate"])
        at_rest = bool(np.all(np.abs(rates) < self._text.rest_rate_dps))
        moving = self._any("moving", answers, otherwise=not at_rest)
        limits = self._travel(answers)
        return TableStatus(
            angles=snap_angles(np.deg2rad(angles)),
            rates=np.deg2rad(rates),
            enabled=self._all("enabled", answers),
            homed=self._all("homed", answers),
            moving=moving,
            settled=self._all("settled", answers, otherwise=self._come_to_rest(angles, moving)),
            fault=self._fault(answers),
            interlock_closed=self._all("interlock", answers, otherwise=True),
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
        """Start homing; a lost answer is a fault, never a second homing."""
        if not self._text.commands.home:
            raise ConfigurationError(
                "table: the profile has no command home; add it, or the flag homed = always"
            )
        self._send("home", repeat=False)

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        """Start both joints towards absolute angles; rad, rad/s, rad/s²."""
        self._still = 0
        self._send("move", angle=(outer, inner), rate=(rate, rate), acceleration=(acceleration, acceleration))

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        """Turn both joints endlessly at these rates until stopped; rad/s, rad/s². See `interfaces.Table`."""
        if not self._text.commands.rate:
            raise ConfigurationError("table: the profile has no command rate; add it")
        self._profile.check_endless(self.status().watchdog, (outer, inner), acceleration)
        self._still = 0
        self._send("rate", rate=(outer, inner), acceleration=(acceleration, acceleration))

    def stop(self) -> None:
        """Decelerate to rest."""
        self._send("stop")

    def reset_fault(self) -> None:
        """Clear a latched fault; the axes stay off."""
        self._send("reset")

    def heartbeat(self) -> None:
        """Feed the table's watchdog, where it has one."""
        self._send("heartbeat")

    def close(self) -> None:
        """Hang up."""
        self._link.close()

    @property
    def heard(self) -> bytes:
        """The bytes that came last, whether they make sense or not."""
        return self._link.heard

    def _send(self, command: str, repeat: bool = True, **values: tuple[float, float]) -> None:
        """Send a command's lines, those with {axis} once for each axis; values in rad."""
        lines: list[str] = getattr(self._text.commands, command)
        numbers = {name: [self._number(float(np.rad2deg(v))) for v in both] for name, both in values.items()}
        named = {f"{j}_{name}": both[i] for name, both in numbers.items() for i, j in enumerate(JOINTS)}
        for line in lines:
            for joint, axis in enumerate(self._text.axes if "{axis}" in line else [""]):
                own = {name: both[joint] for name, both in numbers.items()}
                self._link.command(line.format(axis=axis, **own, **named), repeat)

    def _number(self, value: float) -> str:
        text = f"{value:.{self._text.decimals}f}"
        return text.removeprefix("-") if float(text) == 0.0 else text

    def _poll(self) -> Answers:
        """Answers to all queries but the identity; what is sent alike is sent once.

        Half of the others are asked before the angles and half behind them, so that the angles are amid the poll.
        """
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

    def _query(self, name: str) -> list[dict[str, str]]:
        """Groups of a query's answers. Raises DeviceFaultError where one does not look as the profile says."""
        return [self._read(name, reply) for reply in self._ask(name)]

    def _ask(self, name: str) -> list[str]:
        """Replies to a query, one of each axis where its line names it; each looks as the profile says."""
        query = self._text.queries[name]
        replies = []
        for axis in self._text.axes if "{axis}" in query.send else [""]:
            replies.append(self._link.ask(query.send.format(axis=axis), answer=self._patterns[name]))
            self._read(name, replies[-1])
        return replies

    def _read(self, name: str, reply: str) -> dict[str, str]:
        match = self._patterns[name].search(reply)
        if match is None:
            raise UnlikeAnswerError(
                f"table: '{self._text.queries[name].send}' is answered with '{quoted_text(reply)}', which"
                f" queries.{name} of the profile does not expect; correct its answer"
            )
        return {group: value for group, value in match.groupdict().items() if value is not None}

    def _fault(self, answers: Answers) -> str | None:
        """What is latched, or keeps the table from obeying."""
        if self._any("fault", answers):
            codes = [
                groups["fault"]
                for name in self._text.queries
                for groups in answers.get(name, ())
                if groups.get("fault") not in (None, "0")
            ]
            return self._profile.faults.get(codes[0], f"code {codes[0]}") if codes else UNTOLD
        if not self._all("remote", answers, otherwise=True):
            return LOCAL_CONTROL
        return None

    def _watchdog(self, answers: Answers) -> float:
        if "watchdog" not in self._text.queries:
            return float("inf")
        return min(_number(groups["value"]) for groups in answers["watchdog"])

    def _travel(self, answers: Answers) -> JointLimits:
        """Travel as the table has it set, the profile's where it does not tell."""
        if "limits" not in answers:
            return self._limits
        low, high = (
            [float(np.deg2rad(_number(groups[end]))) for groups in answers["limits"]]
            for end in ("low", "high")
        )
        return JointLimits(
            (low[0], low[-1]), (high[0], high[-1]), self._limits.rate, self._limits.acceleration
        )

    def _come_to_rest(self, angles: FloatArray, moving: bool) -> bool:
        """Whether the angles have stayed where they are for long enough."""
        near = self._angles is not None and bool(
            np.all(np.abs(angles - self._angles) <= self._text.settled_deg)
        )
        self._still = self._still + 1 if near and not moving else 0
        self._angles = angles
        return self._still >= self._text.settled_polls

    def _all(self, name: str, answers: Answers, otherwise: bool = False) -> bool:
        return all(self._flags(name, answers) or [otherwise])

    def _any(self, name: str, answers: Answers, otherwise: bool = False) -> bool:
        return any(self._flags(name, answers) or [otherwise])

    def _flags(self, name: str, answers: Answers) -> list[bool]:
        """A flag of each axis; empty where the profile does not say how it is told."""
        flag = self._text.flags.get(name)
        if flag is None:
            return []
        if flag.query is None:
            return [bool(flag.always)]
        return [_told(flag, groups) for groups in answers[flag.query]]


def _told(flag: Flag, groups: Mapping[str, str]) -> bool:
    text = groups.get(flag.group, "")
    if flag.matches is not None:
        return re.search(flag.matches, text) is not None
    try:
        return bool(int(text, flag.base) >> (flag.bit or 0) & 1)
    except ValueError:
        raise DeviceFaultError(
            f"table: '{text}' is no number of base {flag.base}; correct the flags"
        ) from None


def _joints_of(answers: list[dict[str, str]]) -> FloatArray:
    """A value of both joints, from one answer or two; degrees."""
    if len(answers) == 1:
        return np.array([_number(answers[0][joint]) for joint in JOINTS])
    return np.array([_number(groups["value"]) for groups in answers])


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise DeviceFaultError(
            f"table: '{text}' is no number; correct the query's answer in the table profile"
        )
    return value
