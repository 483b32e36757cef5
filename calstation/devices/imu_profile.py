"""IMU profiles (`data/imus`): stream frame, commands, register map, noise and priors, checked as a whole."""

from itertools import pairwise
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator, model_validator

from calstation.configuration import StrictModel, load, suggestion
from calstation.devices.checks import CRC_WIDTHS
from calstation.devices.frame_profile import FrameSection, hex_bytes, unknown_field
from calstation.devices.link import SerialSettings
from calstation.devices.numbers import number
from calstation.physics.parameters import GROUPS, NAMES, PARAMETERS

CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
STATUS_WORDS = ("status", "status2", "status3")
"""Status words, taken together as one of 48 bits, `status` the lowest 16."""
FIELDS = ("counter", *CHANNELS, "temperature", *STATUS_WORDS)


class StreamSection(StrictModel):
    """`[stream]`: what a count means; units as in a log's `[imu]`.

    order : whether the stream is taken before or after the unit's own calibration registers
    """

    sample_rate_hz: float = Field(gt=0, le=100_000)
    output: Literal["increment", "rate"]
    gyro_lsb: float = Field(gt=0)
    accel_lsb: float = Field(gt=0)
    order: Literal["before_registers", "after_registers"]


class NoiseSection(StrictModel):
    """`[noise]`: rad/√s, m/s/√s, rad/s, m/s²."""

    gyro_arw: float = Field(gt=0)
    accel_vrw: float = Field(gt=0)
    gyro_bias_instability: float = Field(default=0.0, ge=0)
    accel_bias_instability: float = Field(default=0.0, ge=0)


class StatusSection(StrictModel):
    """`[status]`: masks of the status word; 0 where the unit does not tell."""

    ready: int = Field(default=0, ge=0)
    saturated: int = Field(default=0, ge=0)
    failed: int = Field(default=0, ge=0)


class CommandSection(StrictModel):
    """`[commands]`: request and reply frames, sync | op u8 | n u8 | n bytes | check over op to payload.

    timeout_s : host time for an answer; reset_timeout_s : for the unit to answer again after a reset
    """

    request_sync: str
    reply_sync: str
    crc: str
    timeout_s: float = Field(gt=0, le=60)
    reset_timeout_s: float = Field(default=30.0, gt=0)

    @field_validator("request_sync", "reply_sync")
    @classmethod
    def _sync(cls, sync: str) -> str:
        if not hex_bytes(sync):
            raise ValueError('is empty; write bytes like "55 A5"')
        return sync

    @field_validator("crc")
    @classmethod
    def _known(cls, kind: str) -> str:
        if kind not in CRC_WIDTHS:
            raise ValueError(f"check '{kind}' is unknown; it must be one of {', '.join(CRC_WIDTHS)}")
        return kind


class RegisterEntry(StrictModel):
    """Consecutive calibration registers, one address per value; SI value = register × scale.

    parameters : contract names in order, "" for a register that stays 0
    range : lowest and highest SI value that fits
    """

    address: int = Field(ge=0, le=0xFFFF)
    parameters: list[str] = Field(min_length=1)
    type: Literal["f32"] = "f32"
    scale: float = Field(default=1.0, gt=0)
    range: list[float] = Field(min_length=2, max_length=2)

    @property
    def end(self) -> int:
        """First address behind the entry."""
        return self.address + len(self.parameters)

    def __str__(self) -> str:
        return f"register {self.address}-{self.end - 1}"

    @model_validator(mode="after")
    def _sound(self) -> "RegisterEntry":
        for name in self.parameters:
            if name and name not in NAMES:
                raise ValueError(
                    f"{self}: '{name}' is no parameter{suggestion(name, NAMES) or '; remove it'}"
                )
        if self.range[0] >= self.range[1]:
            raise ValueError(f"{self}: range = {self.range} must be [low, high] with low below high")
        return self


_SECTIONS = {"framed": "commands"}
"""The section that each protocol needs."""


class PriorSigma(StrictModel):
    """`[prior.NAME]`: of a parameter or a group, SI."""

    sigma: float = Field(gt=0)


class ImuProfile(StrictModel):
    """One type of IMU: all that driver, register transfer and solvers must know of it.

    model : text that the unit's own model name must contain
    protocol : how it takes commands: framed, by `[commands]`; stream, none at all
    """

    name: str
    model: str
    protocol: Literal["framed", "stream"] = "framed"
    link: SerialSettings
    stream: StreamSection
    frame: FrameSection
    status: StatusSection = StatusSection()
    commands: CommandSection | None = None
    noise: NoiseSection
    registers: list[RegisterEntry] = Field(default_factory=list)
    prior: dict[str, PriorSigma] = Field(default_factory=dict)

    @field_validator("frame")
    @classmethod
    def _sample(cls, frame: FrameSection) -> FrameSection:
        for f in frame.fields:
            if f.name not in FIELDS and not f.name.startswith("spare"):
                raise ValueError(unknown_field(f.name, FIELDS))
        for name in ("counter", *CHANNELS):
            if frame.field(name) is None:
                raise ValueError(f"field '{name}' is missing; add it in its place")
        counter = frame.field("counter")
        if counter is not None and (number(counter.type).kind != "u" or number(counter.type).fraction):
            raise ValueError(f"field 'counter' has type '{counter.type}'; it must be u8 to u64")
        words = [f for f in frame.fields if f.name in STATUS_WORDS]
        for f in words:
            if not number(f.type).whole or (len(words) > 1 and f.width > 2):
                allowed = "u8 or u16" if len(words) > 1 else "a whole number"
                raise ValueError(f"field '{f.name}' has type '{f.type}'; it must be {allowed}")
        return frame

    @field_validator("prior")
    @classmethod
    def _known(cls, prior: dict[str, PriorSigma]) -> dict[str, PriorSigma]:
        for name in prior:
            if name not in NAMES and name not in GROUPS:
                raise ValueError(f"'{name}' is no parameter or group{suggestion(name, NAMES + GROUPS)}")
        return prior

    @field_validator("registers")
    @classmethod
    def _disjoint(cls, registers: list[RegisterEntry]) -> list[RegisterEntry]:
        ordered = sorted(registers, key=lambda r: r.address)
        for a, b in pairwise(ordered):
            if b.address < a.end:
                raise ValueError(f"{a} and {b} overlap; correct an address")
        seen: dict[str, RegisterEntry] = {}
        for entry in ordered:
            for name in filter(None, entry.parameters):
                if name in seen:
                    raise ValueError(f"'{name}' is in {seen[name]} and in {entry}; remove one")
                seen[name] = entry
        return ordered

    @model_validator(mode="after")
    def _section_of_protocol(self) -> "ImuProfile":
        for protocol, section in _SECTIONS.items():
            if (self.protocol == protocol) != (getattr(self, section) is not None):
                raise ValueError(
                    f'protocol = "{self.protocol}" needs [{section}]; add it'
                    if self.protocol == protocol
                    else f'[{section}] does not belong to protocol = "{self.protocol}"; remove it'
                )
        if self.protocol == "stream" and self.registers:
            raise ValueError('registers do not belong to protocol = "stream", which writes none; remove them')
        return self

    @model_validator(mode="after")
    def _syncs_differ(self) -> "ImuProfile":
        if self.commands is None:
            return self
        stream, reply = self.frame.sync_bytes, hex_bytes(self.commands.reply_sync)
        if stream.startswith(reply) or reply.startswith(stream):
            raise ValueError("frame.sync and commands.reply_sync begin alike; frames could not be told apart")
        return self

    @property
    def timeout_s(self) -> float:
        """Host time for an answer, s."""
        return self.commands.timeout_s if self.commands is not None else 1.0

    def with_timeout(self, seconds: float) -> "ImuProfile":
        """The profile with another time for an answer, s."""
        if self.commands is None:
            return self
        return self.model_copy(update={"commands": self.commands.model_copy(update={"timeout_s": seconds})})

    def prior_sigmas(self) -> dict[str, float]:
        """Prior standard deviations by parameter, SI, for those that the profile states."""
        return {
            p.name: self.prior.get(p.name, self.prior.get(p.group, PriorSigma(sigma=1.0))).sigma
            for p in PARAMETERS
            if p.name in self.prior or p.group in self.prior
        }


def load_imu_profile(path: Path) -> ImuProfile:
    """Read and check an IMU profile; raises ConfigurationError naming file, entry and mend."""
    return load(ImuProfile, path)
