"""IMU profiles (`data/imus`): stream frame, commands, register map, noise and priors, validated as a whole."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from calstation.devices.codecs import number
from calstation.devices.profiles.entries import LAST_ADDRESS, ModelName, hex_bytes
from calstation.devices.profiles.frame import CHANNELS, STATUS_WORDS, FrameSection, check_samples, span
from calstation.devices.profiles.imu_sections import (
    CommandSection,
    CommandTimes,
    CorrectedSection,
    ModbusUnitSection,
    NoiseSection,
    StatusSection,
    StreamSection,
    VectorNavSection,
)
from calstation.devices.profiles.registers import RegisterEntry, check_registers
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.physics import GROUPS, NAMES, PARAMETERS, EffectName, FloatArray, entry_of
from calstation.schema import EntryError, StrictModel, entry, load_once, near_miss

#: The section that each protocol requires.
_SECTIONS = {"framed": "commands", "modbus": "modbus", "vectornav": "vectornav"}

#: Shortest period of the counter, s: the loss of a whole period is detected with the host's clock, relative to which
#: samples arrive a few hundredths of a second early or late.
SHORTEST_WRAP = 0.1


#: Default changes of a parameter over a power-up and over a year, in prior sigmas.
_POWER_UP, _YEAR = 0.01, 0.1


class PriorSigma(StrictModel):
    """`[prior.NAME]`: prior standard deviation of a parameter, or of each parameter of a group, SI."""

    sigma: float = Field(gt=0)


class Stability(StrictModel):
    """`[stability.NAME]`: standard deviation of the change of a parameter, or of each parameter of a group, SI.

    power_up : change from one power-up to the next; by default a hundredth of the prior sigma
    year : change within a year, whose variance is proportional to the time; by default a tenth of the prior sigma
    """

    power_up: float | None = Field(default=None, ge=0)
    year: float | None = Field(default=None, ge=0)


class ImuProfile(StrictModel):
    """A type of IMU, with all data that its driver, the register transfer and the solvers need.

    model : text that the unit's own model name must contain
    protocol : command protocol: framed, with `[commands]`; modbus, with `[modbus]`; vectornav, with `[vectornav]`; or
        stream, without commands
    without_register : parameters and groups for which the unit has no register
    flash_cycles_max : number of commits that its data sheet allows
    stability : change of the parameters from power-up to power-up and over time
    states : effects estimated in addition to the 30 parameters
    corrected : how to switch from the raw stream to the stream with the registers applied
    """

    name: str
    model: ModelName
    protocol: Literal["framed", "modbus", "vectornav", "stream"] = "framed"
    link: SerialSettings
    stream: StreamSection
    frame: FrameSection
    status: StatusSection = StatusSection()
    commands: CommandSection | None = None
    modbus: ModbusUnitSection | None = None
    vectornav: VectorNavSection | None = None
    corrected: CorrectedSection | None = None
    flash_cycles_max: int | None = Field(default=None, ge=1)
    noise: NoiseSection
    registers: list[RegisterEntry] = Field(default_factory=list)
    without_register: list[str] = Field(default_factory=list)
    prior: dict[str, PriorSigma] = Field(default_factory=dict)
    stability: dict[str, Stability] = Field(default_factory=dict)
    states: list[EffectName] = Field(default_factory=list)

    @field_validator("frame")
    @classmethod
    def _sample(cls, frame: FrameSection) -> FrameSection:
        check_samples(frame)
        return frame

    @field_validator("prior", "stability")
    @classmethod
    def _parameters(cls, table: dict[str, Any]) -> dict[str, Any]:
        for name in table:
            if name not in NAMES and name not in GROUPS:
                remedy = near_miss(name, NAMES + GROUPS)
                raise EntryError("entry.unknown_parameter", name, name=name, remedy=remedy)
        return table

    @model_validator(mode="before")
    @classmethod
    def _addresses(cls, data: Any) -> Any:
        """Set the protocol's default span (addresses per number) for register entries without a span."""
        if not isinstance(data, dict) or not isinstance(data.get("registers"), list):
            return data
        protocol = data.get("protocol")
        if protocol not in ("vectornav", "modbus"):
            return data
        entries = []
        for given in data["registers"]:
            entry = given
            if isinstance(given, dict) and "span" not in given:
                with suppress(ValueError, TypeError):  # an unknown type is reported by the entry itself
                    width = number(given.get("type", "f32")).width
                    entry = {**given, "span": max(1, width // 2) if protocol == "modbus" else 0}
            entries.append(entry)
        return {**data, "registers": entries}

    @field_validator("registers")
    @classmethod
    def _by_address(cls, registers: list[RegisterEntry]) -> list[RegisterEntry]:
        return sorted((r.at_row(i) for i, r in enumerate(registers)), key=lambda r: r.key)

    @model_validator(mode="after")
    def _section_of_protocol(self) -> "ImuProfile":
        own = f'protocol = "{self.protocol}"'
        for protocol, section in _SECTIONS.items():
            present = getattr(self, section) is not None
            if self.protocol == protocol and not present:
                raise EntryError("profile.needed_by", section, owner=own)
            if self.protocol != protocol and present:
                raise EntryError("profile.not_with", section, other=own)
        if self.protocol == "stream" and self.registers:
            raise EntryError("profile.not_with", "registers", other=own)
        return self

    @model_validator(mode="after")
    def _register_map(self) -> "ImuProfile":
        pages = self.modbus is not None and self.modbus.page is not None
        for register in self.registers:
            if self.protocol == "modbus" and number(register.type).width % 2:
                place = ("registers", register.row, "type")
                raise EntryError("profile.not_whole_registers", *place, type=register.type)
        check_registers(self.registers, self.prior_sigmas(), self.without_register, pages=pages)
        if self.modbus is not None:
            check_modbus_map(self.modbus, self.registers)
        return self

    @model_validator(mode="after")
    def _streams(self) -> "ImuProfile":
        self._check_stream(self.frame, "frame")
        if self.corrected is None:
            return self
        switch = None if self.modbus is None else self.modbus.stream
        raw: tuple[int, ...] | None = (0, 1) if self.protocol == "framed" else None
        if switch is not None:
            raw = switch.values
        check_corrected(self.corrected, self.protocol, self.stream.order, raw)
        if self.corrected.frame is not None:
            with entry("corrected", "frame"):
                check_samples(self.corrected.frame)
            self._check_stream(self.corrected.frame, "corrected", "frame")
        return self

    def _check_stream(self, frame: FrameSection, *place: str) -> None:
        rate, name = self.stream.sample_rate_hz, ".".join(place)
        check_status(self.status, frame, name)
        if "baud" in self.link.model_fields_set:
            check_baud(self.link, frame, rate, name)
        with entry(*place):
            check_wrap(frame, rate)
            if self.protocol == "vectornav":
                check_nanoseconds(frame, rate)
            if self.commands is not None:
                check_sync(frame, hex_bytes(self.commands.reply_sync))

    @property
    def frames(self) -> tuple[FrameSection, ...]:
        """The frames of all streams that the unit can send."""
        own = self.corrected.frame if self.corrected is not None else None
        return (self.frame,) if own is None else (self.frame, own)

    @property
    def quantised_stream(self) -> StreamSection:
        """The stream with the quantisation that follows from the frame: one count if not otherwise specified."""
        steps, found = span(self.frame).step, {}
        for sensor, step in (("gyro", steps[:3].max()), ("accel", steps[3:].max())):
            if getattr(self.stream, f"{sensor}_quantisation") is None and step != 1.0:
                known = float(step) if np.isfinite(step) else 0.0
                found[f"{sensor}_quantisation"] = known * getattr(self.stream, f"{sensor}_lsb")
        return self.stream.model_copy(update=found)

    @property
    def timeout_s(self) -> float:
        """Reply timeout, host time in s."""
        return 1.0 if self.command_times is None else self.command_times.timeout_s

    @property
    def command_times(self) -> CommandTimes | None:
        """The section of the command protocol; None for a unit without commands."""
        return self.commands or self.modbus or self.vectornav

    def with_timeout(self, seconds: float) -> "ImuProfile":
        """Return the profile with another reply timeout, host time in s."""
        name = _SECTIONS.get(self.protocol)
        if name is None:
            return self
        section = getattr(self, name).model_copy(update={"timeout_s": seconds})
        return self.model_copy(update={name: section})

    def prior_sigmas(self) -> dict[str, float]:
        """Return the prior standard deviation, SI, of each parameter that has a prior, by name."""
        found = {p.name: entry_of(self.prior, p.name) for p in PARAMETERS}
        return {name: prior.sigma for name, prior in found.items() if prior is not None}

    def change_sigmas(self, years: float) -> FloatArray:
        """Return the standard deviation, SI, shape (30,), of each parameter's change over a power-up and some years."""
        priors = self.prior_sigmas()
        changes = []
        for parameter in PARAMETERS:
            found = entry_of(self.stability, parameter.name) or Stability()
            prior = priors.get(parameter.name, parameter.prior_sigma)
            power_up = _POWER_UP * prior if found.power_up is None else found.power_up
            year = _YEAR * prior if found.year is None else found.year
            changes.append(np.hypot(power_up, year * np.sqrt(years)))
        return np.array(changes)


def check_status(status: StatusSection, frame: FrameSection, name: str) -> None:
    """Check that the frame `name` contains the bits of the status masks, and that no bit has two meanings."""
    words = [(i, frame.field(word)) for i, word in enumerate(STATUS_WORDS)]
    present = sum(((1 << 8 * f.width) - 1) << 16 * i for i, f in words if f is not None)
    masks = {"ready": status.ready, "saturated": status.saturated, "failed": status.failed}
    for key, mask in masks.items():
        if mask & ~present:
            raise EntryError("profile.mask_outside_frame", "status", key, value=mask, frame=name)
    for key in ("saturated", "failed"):
        if masks["ready"] & masks[key]:
            raise EntryError("profile.mask_of_ready", "status", key)


def check_baud(settings: SerialSettings, frame: FrameSection, rate: float, name: str = "frame") -> None:
    """Check that the serial line can transmit `rate` samples per second; `name` is the name of the frame."""
    size = frame.min_size(("counter", *CHANNELS))
    needed = settings.bits_per_byte * size * rate
    if needed > settings.baud:
        values = {"frame": name, "size": size, "rate": rate, "needed": needed}
        raise EntryError("profile.baud_too_low", "link", "baud", baud=settings.baud, **values)


def check_nanoseconds(frame: FrameSection, rate: float) -> None:
    """Check that a VectorNav's clock in nanoseconds agrees with its sample rate."""
    counter = frame.named("counter")
    expected = 1e9 / rate
    if counter.per_sample != 1.0 and abs(counter.per_sample - expected) > 1e-3 * expected:
        place = ("fields", frame.fields.index(counter), "per_sample")
        raise EntryError("profile.clock_rate", *place, value=counter.per_sample, rate=rate, expected=expected)


def check_wrap(frame: FrameSection, rate: float) -> None:
    """Check that the counter's period is long enough to detect lost samples."""
    seconds = frame.counter_period / rate
    if seconds < SHORTEST_WRAP:
        counter = frame.named("counter")
        place = ("fields", frame.fields.index(counter), "type")
        raise EntryError("profile.counter_too_short", *place, type=counter.type, seconds=seconds, rate=rate)


def check_sync(frame: FrameSection, reply_sync: bytes) -> None:
    """Check that frames can be distinguished from replies."""
    sync = frame.sync_bytes
    if sync.startswith(reply_sync) or reply_sync.startswith(sync):
        raise EntryError("profile.sync_of_replies", "sync")


def check_corrected(section: CorrectedSection, protocol: str, order: str, raw: tuple[int, ...] | None) -> None:
    """Check that `[corrected]` is consistent with the protocol and the stream order of its profile.

    raw : values that switch the raw stream on and off; None if the link has no such switch
    """
    if order == "after_registers":
        raise EntryError("profile.not_with", "corrected", other='stream.order = "after_registers"')
    if protocol == "stream":
        raise EntryError("profile.not_with", "corrected", other='protocol = "stream"')
    needed, other = ("start", "stream") if protocol == "vectornav" else ("stream", "start")
    if not _is_set(section, needed):
        raise EntryError("profile.needed_by", "corrected", needed, owner=f'protocol = "{protocol}"')
    if _is_set(section, other):
        raise EntryError("profile.not_with", "corrected", other, other=f'protocol = "{protocol}"')
    if section.stream is None:
        return
    if raw is None:
        raise EntryError("profile.needed_by", "modbus", "stream", owner="corrected.stream")
    if section.stream in raw:
        raise EntryError("profile.stream_value_of_raw", "corrected", "stream", value=section.stream)
    if protocol == "framed" and section.stream > 0xFF:
        raise EntryError("entry.out_of_range", "corrected", "stream", value=section.stream, low=2, high=255)


def _is_set(section: CorrectedSection, name: str) -> bool:
    return getattr(section, name) not in (None, [])


def check_modbus_map(section: ModbusUnitSection, entries: Sequence[RegisterEntry]) -> None:
    """Check that the unit's own registers and its calibration registers do not overlap.

    Commands and the page register exist on every page, so calibration registers must not overlap them on any page.
    """
    own, written = section.ranges, section.written
    for name, (begin, end) in own.items():
        if end - 1 > LAST_ADDRESS:
            raise EntryError("profile.past_last_address", "modbus", name, address=begin, last=end - 1)
    for (a, at), (b, other) in combinations(own.items(), 2):
        distinguished = a in written and b in written  # by the written value
        if not distinguished and at[0] < other[1] and other[0] < at[1]:
            values = {"mine": _span(*other), "other": f"modbus.{a}", "at": _span(*at)}
            raise EntryError("profile.registers_overlap", "modbus", b, **values)
    for a, b in combinations(written, 2):
        if own[a] == own[b] and set(written[a]) & set(written[b]):
            raise EntryError("profile.same_write", "modbus", b, other=f"modbus.{a}")
    for command in ("commit", "reset"):
        order = getattr(section, command)
        if order.done == order.value:
            raise EntryError("profile.done_at_once", "modbus", command, "done", value=order.done)
    for register in entries:
        with entry("registers", register.row):
            _check_span(register, own)


def _check_span(register: RegisterEntry, own: Mapping[str, tuple[int, int]]) -> None:
    needed = number(register.type).width // 2
    if register.span != needed:
        raise EntryError("profile.span", "span", value=register.span, type=register.type, needed=needed)
    for name, (begin, end) in own.items():
        if register.address < end and begin < register.end:
            values = {"mine": register.label, "other": f"modbus.{name}", "at": _span(begin, end)}
            raise EntryError("profile.registers_overlap", "address", **values)


def _span(begin: int, end: int) -> str:
    return f"{begin}" if end - begin == 1 else f"{begin}-{end - 1}"


def load_imu_profile(path: Path) -> ImuProfile:
    """Read and check an IMU profile; raises ConfigurationError naming file, entry and remedy."""
    return load_once(ImuProfile, path)
