"""What a connection test found, as ids and values: the listener words them, in its language."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

#: In order, worth knowing, a run would not start like this though the link is right, the link or a setting is wrong.
State = Literal["ok", "told", "look", "wrong"]

_WORST: tuple[State, ...] = ("wrong", "look", "ok")

Value = str | float | int


@dataclass(frozen=True)
class Finding:
    """One line of a test."""

    id: str
    state: State
    values: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Report:
    """A test of one device, ``table`` or ``imu``, in the order in which it was done."""

    device: str
    findings: tuple[Finding, ...]

    @property
    def state(self) -> State:
        """The worst of the findings."""
        states = {finding.state for finding in self.findings}
        return next((state for state in _WORST if state in states), "ok")

    def find(self, name: str) -> Finding | None:
        """The finding of an id, None where the test did not make it."""
        return next((finding for finding in self.findings if finding.id == name), None)
