"""IMU profiles (`data/imus`), which define frames, commands, register map, noise and priors."""

from collections.abc import Iterator
from contextlib import suppress
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import Field, create_model, field_validator, model_validator

from calstation.devices.codecs import number
from calstation.devices.profiles.entries import (
    CommandLine,
    ModelName,
    ProfileSection,
    Rules,
    SerialSettings,
    TemperatureRange,
    Word,
    excludes,
    needs,
    only_if,
    violations,
    with_prefix,
)
from calstation.devices.profiles.frame import (
    CHANNELS,
    SAMPLE_RULES,
    STATUS_WORDS,
    FrameSection,
    SampleFrame,
    channel_range,
)
from calstation.devices.profiles.imu_protocols import PROTOCOLS, ImuProtocol
from calstation.devices.profiles.registers import REGISTER_RULES, RegisterEntry
from calstation.physics import GROUPS, NAMES, PARAMETERS, STANDARD_GRAVITY, EffectName, FloatArray, entry_of
from calstation.schema import EntryError, KeyPath, StrictModel, check_names, load_once

P = TypeVar("P", bound=ImuProtocol)

#: Shortest period of the counter, s. The loss of a full period is detected by the host's clock, relative to which the
#: arrival times of samples vary by a few hundredths of a second.
MIN_WRAP_TIME = 0.1

#: Default changes of a parameter at a power-up and over a year, in prior sigmas.
_POWER_UP, _YEAR = 0.01, 0.1

#: Largest random walks, 100 °/√h in rad/√s and 0.1 g/√Hz in m/s/√s.
_MAX_ARW, _MAX_VRW = radians(100.0) / 60.0, 0.1 * STANDARD_GRAVITY
#: Largest bias instabilities, 100 000 °/h in rad/s and 1 g in m/s².
_MAX_GYRO_INSTABILITY, _MAX_ACCEL_INSTABILITY = radians(1e5) / 3600.0, STANDARD_GRAVITY

#: The entry that selects the protocol, as written in messages.
_PROTOCOL = 'protocol = "{0.protocol}"'


class StreamSection(StrictModel):
    """`[stream]`: sample rate and meaning of a count, in the units of the section `[imu]` of a log."""

    sample_rate_hz: float = Field(gt=0, le=100_000)
    output: Literal["increment", "rate"]
    gyro_lsb: float = Field(gt=0)
    accel_lsb: float = Field(gt=0)
    gyro_quantisation: float | None = Field(default=None, ge=0, le=1)
    accel_quantisation: float | None = Field(default=None, ge=0, le=10)
    bandwidth_hz: float | None = Field(default=None, gt=0, le=100_000)
    coning_compensated: bool = False
    order: Literal["before_registers", "after_registers"]


class NoiseSection(StrictModel):
    """`[noise]`: random walks in rad/√s and m/s/√s, bias instabilities in rad/s and m/s²."""

    gyro_arw: float = Field(gt=0, le=_MAX_ARW)
    accel_vrw: float = Field(gt=0, le=_MAX_VRW)
    gyro_bias_instability: float = Field(default=0.0, ge=0, le=_MAX_GYRO_INSTABILITY)
    accel_bias_instability: float = Field(default=0.0, ge=0, le=_MAX_ACCEL_INSTABILITY)


class StatusSection(StrictModel):
    """`[status]`: masks of the status word; 0 for a state that the unit does not report."""

    ready: int = Field(default=0, ge=0)
    saturated: int = Field(default=0, ge=0)
    failed: int = Field(default=0, ge=0)


class CorrectedSection(StrictModel):
    """`[corrected]`: command that starts the stream with the registers applied, and the frame of this stream."""

    stream: Word | None = None
    start: list[CommandLine] = Field(default_factory=list)
    frame: FrameSection | None = None


class PriorSigma(StrictModel):
    """`[prior.NAME]`: prior standard deviation of a parameter, or of each parameter of a group, SI."""

    sigma: float = Field(gt=0, le=100)


class Stability(StrictModel):
    """`[stability.NAME]`: standard deviation of the change of a parameter, or of each parameter of a group, SI.

    power_up : change from one power-up to the next; the default is a hundredth of the prior sigma
    year : change over a year; the default is a tenth of the prior sigma. The variance is proportional to the time
    """

    power_up: float | None = Field(default=None, ge=0, le=100)
    year: float | None = Field(default=None, ge=0, le=100)


if TYPE_CHECKING:

    class _ProtocolSections(ProfileSection):
        protocol: str

else:  # the sections are fields, so that errors name them as in the file
    _ProtocolSections = create_model(
        "_ProtocolSections",
        __base__=ProfileSection,
        protocol=(Literal["stream", *PROTOCOLS], "framed"),
        **{protocol.section: (protocol | None, None) for protocol in PROTOCOLS.values()},
    )


class ImuProfile(_ProtocolSections):
    """A type of IMU, with all data for its driver, the register transfer and the solvers.

    `range_c` is the range of ambient temperatures in which the unit may be operated, °C; it is required in a chamber.
    """

    name: str
    model: ModelName
    range_c: TemperatureRange | None = None
    link: SerialSettings
    stream: StreamSection
    frame: SampleFrame
    status: StatusSection = StatusSection()
    corrected: CorrectedSection | None = None
    flash_cycles_max: int | None = Field(default=None, ge=1)
    noise: NoiseSection
    registers: list[RegisterEntry] = Field(default_factory=list)
    without_register: list[str] = Field(default_factory=list)
    prior: dict[str, PriorSigma] = Field(default_factory=dict)
    stability: dict[str, Stability] = Field(default_factory=dict)
    states: list[EffectName] = Field(default_factory=list)

    @field_validator("prior", "stability")
    @classmethod
    def _check_parameters(cls, table: dict[str, Any]) -> dict[str, Any]:
        check_names(table, NAMES + GROUPS)
        return table

    @model_validator(mode="before")
    @classmethod
    def _set_spans(cls, data: Any) -> Any:
        """Set the default span (addresses per number) of the protocol in register entries without a span."""
        if not isinstance(data, dict) or not isinstance(data.get("registers"), list):
            return data
        name = data.get("protocol")
        protocol = PROTOCOLS.get(name, ImuProtocol) if isinstance(name, str) else ImuProtocol
        entries = []
        for entry_data in data["registers"]:
            entry = entry_data
            if isinstance(entry_data, dict) and "span" not in entry_data:
                with suppress(ValueError, TypeError):  # the validation of the entry reports an unknown type
                    entry = {**entry_data, "span": protocol.address_span(number(entry_data.get("type", "f32")).width)}
            entries.append(entry)
        return {**data, "registers": entries}

    @field_validator("registers")
    @classmethod
    def _sort_by_address(cls, registers: list[RegisterEntry]) -> list[RegisterEntry]:
        return sorted((r.with_row(i) for i, r in enumerate(registers)), key=lambda r: r.key)

    rules: ClassVar[Rules["ImuProfile"]] = (
        lambda p: (
            error
            for name, protocol in PROTOCOLS.items()
            for rule in [needs if name == p.protocol else excludes]
            for error in violations(p, (rule(_PROTOCOL, protocol.section),))
        ),
        *only_if(lambda p: not p.has_commands, excludes(_PROTOCOL, "registers")),
        *only_if(
            lambda p: p.stream.order == "after_registers", excludes('stream.order = "after_registers"', "corrected")
        ),
        *only_if(lambda p: not p.has_commands, excludes(_PROTOCOL, "corrected")),
        *only_if(lambda p: p.corrected is not None, lambda p: _corrected_errors(p, p.corrected, p.protocol_section)),
        lambda p: (error for at, frame in p.frames.items() for error in _frame_errors(p, frame, at)),
        lambda p: p.protocol_section is not None and violations(p, p.protocol_section.profile_rules),
        *REGISTER_RULES,
    )

    @property
    def frames(self) -> dict[tuple[str, ...], FrameSection]:
        """The frames of all streams of the unit, by key path in the profile."""
        corrected = self.corrected.frame if self.corrected is not None else None
        return {("frame",): self.frame} | ({} if corrected is None else {("corrected", "frame"): corrected})

    @property
    def quantised_stream(self) -> StreamSection:
        """The stream with its quantisation, which is one count unless the profile or the frame specifies another."""
        steps, changes = channel_range(self.frame).step, {}
        for sensor, step in (("gyro", steps[:3].max()), ("accel", steps[3:].max())):
            if getattr(self.stream, f"{sensor}_quantisation") is None and step != 1.0:
                known = float(step) if np.isfinite(step) else 0.0
                changes[f"{sensor}_quantisation"] = known * getattr(self.stream, f"{sensor}_lsb")
        return self.stream.model_copy(update=changes)

    @property
    def protocol_section(self) -> ImuProtocol | None:
        """The section of the command protocol; None for a unit without commands."""
        protocol = PROTOCOLS.get(self.protocol)
        return None if protocol is None else getattr(self, protocol.section)

    @property
    def has_commands(self) -> bool:
        """Whether the unit accepts commands, instead of only streaming."""
        return self.protocol_section is not None

    def section_of(self, kind: type[P]) -> P:
        """Return the section of the command protocol `kind`. Raises TypeError if the unit has another protocol."""
        section = self.protocol_section
        if not isinstance(section, kind):
            raise TypeError(f"{self.name} has protocol {self.protocol!r}")
        return section

    @property
    def timeout_s(self) -> float:
        """Timeout for a reply, host time in s."""
        return 1.0 if self.protocol_section is None else self.protocol_section.timeout_s

    def with_commands(self, **entries: Any) -> "ImuProfile":
        """Return the profile with changed entries in the section of its protocol, if it has one."""
        section = self.protocol_section
        return (
            self if section is None else self.model_copy(update={section.section: section.model_copy(update=entries)})
        )

    def prior_sigmas(self) -> dict[str, float]:
        """Return the prior standard deviation, SI, of each parameter that has a prior, by name."""
        priors = {p.name: entry_of(self.prior, p.name) for p in PARAMETERS}
        return {name: prior.sigma for name, prior in priors.items() if prior is not None}

    def change_sigmas(self, years: float) -> FloatArray:
        """Return the sigma, SI, shape (30,), of each parameter's change over a power-up and a number of years."""
        priors = self.prior_sigmas()
        changes = []
        for parameter in PARAMETERS:
            stability = entry_of(self.stability, parameter.name) or Stability()
            prior = priors.get(parameter.name, parameter.prior_sigma)
            power_up = _POWER_UP * prior if stability.power_up is None else stability.power_up
            year = _YEAR * prior if stability.year is None else stability.year
            changes.append(np.hypot(power_up, year * np.sqrt(years)))
        return np.array(changes)


def _corrected_errors(profile: ImuProfile, section: CorrectedSection, commands: ImuProtocol) -> Iterator[EntryError]:
    """Yield the errors in the section of the corrected stream."""
    for name in sorted(("stream", "start"), key=lambda name: name != commands.corrected_entry):
        rule = needs if name == commands.corrected_entry else excludes
        owner = _PROTOCOL.format(profile)
        yield from (with_prefix(error, "corrected") for error in violations(section, (rule(owner, name),)))
    if section.stream is not None:
        raw = commands.raw_stream
        if raw is None:
            yield EntryError("profile.needed_by", commands.section, "stream", owner="corrected.stream")
        elif section.stream in raw:
            yield EntryError("profile.stream_value_of_raw", "corrected", "stream", value=section.stream)
    if section.frame is not None:
        yield from (with_prefix(error, "corrected", "frame") for error in violations(section.frame, SAMPLE_RULES))


def _frame_errors(profile: ImuProfile, frame: FrameSection, key_path: KeyPath) -> Iterator[EntryError]:
    """Yield the errors in the status masks, the baud rate and the counter of a frame."""
    name, status, rate = ".".join(map(str, key_path)), profile.status, profile.stream.sample_rate_hz
    words = [(i, frame.field(word)) for i, word in enumerate(STATUS_WORDS)]
    present = sum(((1 << 8 * f.width) - 1) << 16 * i for i, f in words if f is not None)
    for key, mask in status:
        if mask & ~present:
            yield EntryError("profile.mask_outside_frame", "status", key, value=mask, frame=name)
    for key in ("saturated", "failed"):
        if status.ready & getattr(status, key):
            yield EntryError("profile.mask_of_ready", "status", key)
    if "baud" in profile.link.model_fields_set:
        check_baud(profile.link, frame, rate, name)
    counter, seconds = frame.required_field("counter"), frame.counter_period / rate
    if seconds < MIN_WRAP_TIME:
        at = (*key_path, "fields", frame.fields.index(counter), "type")
        yield EntryError("profile.counter_too_short", *at, type=counter.type, seconds=seconds, rate=rate)


def check_baud(settings: SerialSettings, frame: FrameSection, rate: float, name: str = "frame") -> None:
    """Check that a serial line can transmit the sample stream. Raises EntryError.

    Parameters
    ----------
    settings : settings of the serial port
    frame : frame of a sample
    rate : sample rate, Hz
    name : entry of the frame in the profile, for the error
    """
    size = frame.min_size(("counter", *CHANNELS))
    needed = settings.bits_per_byte * size * rate
    if needed > settings.baud:
        values = {"frame": name, "size": size, "rate": rate, "needed": needed}
        raise EntryError("profile.baud_too_low", "link", "baud", baud=settings.baud, **values)


def load_imu_profile(path: Path) -> ImuProfile:
    """Read and check an IMU profile. Raises ConfigurationError with the file, entry and remedy."""
    return load_once(ImuProfile, path)
