"""The section `[gimbal]` of a gimbal's profile: the lines of text of its commands and queries."""

from typing import ClassVar

from pydantic import Field, model_validator

from calstation.devices.profiles.text import CommandLines, TextSection
from calstation.schema import EntryError


class GimbalCommands(CommandLines):
    """`[gimbal.commands]`: the lines of each command, in order.

    home : move all joints to zero and lock them; lock : lock the joints and average the gyro output as the gyro bias;
    stabilise : hold the body at rest in space on the corrected rates; turn : turn about the body axis {axis} by {angle}
    at {rate} with the others stabilised, not repeated if its reply is lost
    """

    home: list[str] = Field(min_length=1)
    move: list[str] = Field(default_factory=list, max_length=0)
    lock: list[str] = Field(min_length=1)
    stabilise: list[str] = Field(min_length=1)
    turn: list[str] = Field(min_length=1)


class GimbalSection(TextSection):
    """`[gimbal]`: like `[text]` with three axes, the names of the joints x, y and z in the lines."""

    joint_names: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    commands: GimbalCommands

    @model_validator(mode="after")
    def _has_watchdog(self) -> "GimbalSection":
        if not self.commands.heartbeat:
            raise EntryError("entry.missing", "commands", "heartbeat")
        return self
