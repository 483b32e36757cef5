"""Table profiles (`data/tables`), which define axes, limits, accuracy, and registers or lines of text."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import AfterValidator, Field

from calstation.devices.profiles.entries import (
    ModelName,
    ProfileSection,
    Rules,
    SerialSettings,
    TemperatureRange,
    excludes,
    needs,
    only_if,
    require,
    violations,
    with_prefix,
)
from calstation.devices.profiles.table_registers import (
    JOINTS,
    MAP_RULES,
    JointSection,
    ModbusRegister,
    StatusBits,
    TableCommands,
    TableMap,
)
from calstation.devices.profiles.text import GimbalSection, TextSection
from calstation.errors import ConfigurationError
from calstation.physics import AXES, AXIS_OFFSET_SIGMA, GimbalJoints, JointLimits, TableGeometry
from calstation.schema import EntryError, StrictModel, load_once

#: Section of each protocol; a new protocol is added here, and the driver for its section in `table.drivers`.
PROTOCOLS = {
    "modbus": "modbus",
    "imu_link": "imu_link",
    "atl": "text",
    "acl": "text",
    "mn": "text",
    "gimbal": "gimbal",
    "hand": None,
}
if TYPE_CHECKING:
    ProtocolName = str
else:
    ProtocolName = Literal[tuple(PROTOCOLS)]

#: The entry that selects the protocol, as written in messages.
_PROTOCOL = 'protocol = "{0.protocol}"'

#: Entry of `[text]` that defines the framing of lines, by protocol.
_FRAMING = {"atl": "prompt", "mn": "checked"}

#: Largest rounding of an angle in a text line, in standard deviations of the encoder.
_MAX_ROUNDING = 3.0
#: Largest sigma of the encoders of a driven table, °.
_MAX_ENCODER_SIGMA = 5.0

#: Relative tolerance of a rate or acceleration at its limit.
_RELATIVE_TOLERANCE = 1e-9

S = TypeVar("S", bound=StrictModel)


def _check_length(axis: list[float]) -> list[float]:
    length = math.hypot(*axis)
    return require(axis, abs(length - 1.0) <= 1e-3, "profile.not_a_unit_vector", length=length)


UnitVector = Annotated[list[float], Field(min_length=3, max_length=3), AfterValidator(_check_length)]


class ImuLinkSection(ProfileSection):
    """`[imu_link]`: the axes of an inertial system, which are commanded over its link."""

    gap: int = Field(default=0, ge=0, le=100)
    word_order: Literal["big", "little"] = "big"
    rest_rate_dps: float = Field(default=0.002, gt=0, le=10)


class ModbusSection(ImuLinkSection):
    """`[modbus]`: unit numbers, timeout and serial settings, in addition to the entries of `[imu_link]`."""

    unit: int = Field(ge=0, le=255)
    inner_unit: int | None = Field(default=None, ge=1, le=247)
    timeout_s: float = Field(gt=0, le=60)
    serial: SerialSettings = SerialSettings()

    rules: ClassVar[Rules["ModbusSection"]] = (
        lambda modbus: (
            modbus.unit == modbus.inner_unit and EntryError("profile.same_unit", "inner_unit", unit=modbus.unit)
        ),
    )


class AccuracySection(StrictModel):
    """`[accuracy]`: uncertainties of angles and rests, as in `[table]` of a log, and the age of polled angles, s."""

    encoder_sigma_deg: float = Field(gt=0, le=90)
    mount_sigma_deg: float = Field(gt=0, le=180)
    azimuth_sigma_deg: float = Field(gt=0, le=180)
    base_tilt_sigma_deg: float = Field(gt=0, le=90)
    velocity_sigma: float = Field(gt=0, le=10)
    velocity_interval_s: float = Field(gt=0, le=60)
    axis_offset_mm: tuple[float, float] = Field(default=(0.0, 0.0), strict=False)
    axis_offset_sigma_mm: Annotated[float, Field(gt=0, le=100)] = 1e3 * AXIS_OFFSET_SIGMA
    repeatability_deg: float | None = Field(default=None, gt=0, le=1)
    poll_latency_s: float = Field(default=0.0, ge=0, le=1)
    poll_jitter_s: float = Field(default=0.0, ge=0, le=1)


class TableProfile(ProfileSection):
    """A type of table, with all data for its driver, the plans and the solvers.

    range_c : range of ambient temperatures in which the table may be operated, °C; required in a chamber
    link_loss_stop_s : time after the last received line within which a table without a watchdog stops its axes, s; if
        it is None, continuous rotation is not allowed
    """

    name: str
    model: ModelName
    protocol: ProtocolName
    outer_axis: UnitVector
    inner_axis: UnitVector
    outer_lever: Literal["estimated", "fixed"]
    settle_s: float = Field(default=1.5, ge=0, le=60)
    range_c: TemperatureRange | None = None
    outer: JointSection
    inner: JointSection
    middle_axis: list[float] | None = Field(default=None, min_length=3, max_length=3)
    middle: JointSection | None = None
    accuracy: AccuracySection
    link_loss_stop_s: float | None = Field(default=None, gt=0, le=60)
    faults: dict[str, str]
    modbus: ModbusSection | None = None
    imu_link: ImuLinkSection | None = None
    status_bits: StatusBits | None = None
    commands: TableCommands | None = None
    registers: dict[str, ModbusRegister] = Field(default_factory=dict)
    text: TextSection | None = None
    gimbal: GimbalSection | None = None

    rules: ClassVar[Rules["TableProfile"]] = (
        lambda p: "0" in p.faults and EntryError("profile.fault_zero", "faults", "0"),
        lambda p: not p.by_hand and _encoder_error(p.accuracy.encoder_sigma_deg),
        lambda p: abs(float(np.dot(p.outer_axis, p.inner_axis))) > 0.5 and EntryError("profile.axes_too_close"),
        lambda p: p.section != "" and needs(_PROTOCOL, p.section)(p),
        lambda p: excludes(_PROTOCOL, *(name for name in PROTOCOLS.values() if name not in (None, p.section)))(p),
        *only_if(lambda p: p.gimbal is None, excludes(_PROTOCOL, "middle", "middle_axis")),
        *only_if(
            lambda p: p.gimbal is not None,
            needs(_PROTOCOL, "middle", "middle_axis"),
            lambda p: sorted(p.joint_order) != sorted(AXES) and EntryError("profile.gimbal_axes", "middle_axis"),
        ),
        *only_if(lambda p: p.lines is None and not p.by_hand, *MAP_RULES),
        *only_if(lambda p: p.lines or p.by_hand, excludes(_PROTOCOL, "status_bits", "commands", "registers")),
        *only_if(lambda p: p.by_hand, excludes(_PROTOCOL, "link_loss_stop_s")),
        lambda p: p.lines is not None and _framing_errors(p, p.lines),
    )

    @property
    def joint_order(self) -> str:
        """Letters of a gimbal's joints from base to body; "" for a table."""
        if self.gimbal is None or self.middle_axis is None:
            return ""
        vectors = (self.outer_axis, self.middle_axis, self.inner_axis)
        return "".join(AXES[int(np.argmax(v))] for v in vectors if max(v) > 1.0 - 1e-3)

    @property
    def lines(self) -> TextSection | None:
        """The section with the lines of text; None for other protocols."""
        return self.text or self.gimbal

    @property
    def section(self) -> str:
        """Name of the section of the protocol; "" for a manual rig."""
        return PROTOCOLS[self.protocol] or ""

    def section_of(self, kind: type[S]) -> S:
        """Return the section of the protocol. Raises TypeError if it is of another type than `kind`."""
        section = getattr(self, self.section, None)
        if not isinstance(section, kind):
            raise TypeError(f"{self.name} has protocol {self.protocol!r}")
        return section

    @property
    def map(self) -> TableMap:
        """Registers, bits and commands, with the word order of each register on the link."""
        section = self.modbus or self.imu_link
        order = section.word_order if section is not None else "big"
        registers = {
            name: register
            if register.type == "text" or register.word_order is not None
            else register.model_copy(update={"word_order": order})
            for name, register in self.registers.items()
        }
        if self.status_bits is None or self.commands is None:
            raise EntryError("entry.missing", "commands" if self.status_bits else "status_bits")
        return TableMap(registers, self.status_bits, self.commands, self.two_drives)

    @property
    def two_drives(self) -> bool:
        """Whether each axis has a separate drive with registers."""
        return self.modbus is not None and self.modbus.inner_unit is not None

    @property
    def by_hand(self) -> bool:
        """Whether the table is a manual rig, which has no link and whose angles are unknown."""
        return self.protocol == "hand"

    @property
    def serial(self) -> SerialSettings:
        """Settings of the serial port, unless the station specifies others."""
        section = self.lines or self.modbus
        return section.serial if section is not None else SerialSettings()

    @property
    def timeout_s(self) -> float:
        """Timeout for a reply, host time in s."""
        section = self.lines or self.modbus
        return section.timeout_s if section is not None else 1.0

    @property
    def unit(self) -> int | None:
        """Modbus unit number; None if the table has none."""
        return self.modbus.unit if self.modbus is not None else None

    def at_station(self, timeout_s: float | None, unit: int | None) -> "TableProfile":
        """Return the profile with the reply timeout and unit number of a station, unless they are None.

        Raises ConfigurationError if the drive of the inner axis has this unit number.
        """
        section = self.lines or self.modbus
        if section is None:
            return self
        if self.modbus is not None and unit is not None and unit == self.modbus.inner_unit:
            raise ConfigurationError("table.unit_of_inner_drive", unit=unit)
        changes = {"timeout_s": timeout_s, "unit": None if self.modbus is None else unit}
        changed = section.model_copy(update={key: value for key, value in changes.items() if value is not None})
        return self.model_copy(update={self.section: changed})

    def check_continuous_rotation(self, watchdog: float, rates: tuple[float, float], acceleration: float) -> None:
        """Check that the table may rotate continuously.

        Raises ConfigurationError if the table would not stop after a link loss, or a limit is exceeded.

        Parameters
        ----------
        watchdog : timeout of the table's watchdog, s; 0 if it is off, infinite if there is none
        rates : rates of outer and inner joint, rad/s
        acceleration : acceleration of both joints, rad/s²
        """
        if not 0.0 < watchdog < math.inf and self.link_loss_stop_s is None:
            raise ConfigurationError("table.would_not_stop", profile=self.name)
        limits = self.geometry().limits
        for axis, rate, limit in zip(JOINTS, rates, limits.rate, strict=True):
            if not abs(rate) <= limit * (1.0 + _RELATIVE_TOLERANCE):
                values = {"rate_dps": math.degrees(rate), "limit_dps": math.degrees(limit)}
                raise ConfigurationError("table.rate_above_limit", axis=axis, **values)
        limit = min(limits.acceleration)
        if not 0.0 < acceleration <= limit * (1.0 + _RELATIVE_TOLERANCE):
            values = {"acceleration_dps2": math.degrees(acceleration), "limit_dps2": math.degrees(limit)}
            raise ConfigurationError("table.acceleration_outside_limits", **values)

    def geometry(self) -> TableGeometry:
        """Return the axes as unit vectors, and the limits of the joints in rad, rad/s and rad/s²."""
        outer, inner, middle = self.outer, self.inner, self.middle
        gimbal = None
        if middle is not None:
            sections = dict(zip(self.joint_order, (outer, middle, inner), strict=True))
            x, y, z = (_radians(sections[a].low_deg, sections[a].high_deg) for a in AXES)
            rate = float(np.deg2rad(min(s.max_rate_dps for s in sections.values())))
            gimbal = GimbalJoints(self.joint_order, (x, y, z), rate)
        return TableGeometry(
            _normalised(self.outer_axis),
            _normalised(self.inner_axis),
            JointLimits(
                low=_radians(outer.low_deg, inner.low_deg),
                high=_radians(outer.high_deg, inner.high_deg),
                rate=_radians(outer.max_rate_dps, inner.max_rate_dps),
                acceleration=_radians(outer.max_acceleration_dps2, inner.max_acceleration_dps2),
            ),
            gimbal,
        )


def _encoder_error(sigma: float) -> EntryError | None:
    """Return an error if a sigma, °, is too large for an encoder; a manual rig has none and may exceed the limit."""
    values = {"value": sigma, "bound": _MAX_ENCODER_SIGMA}
    return (
        EntryError("entry.less_than_equal", "accuracy", "encoder_sigma_deg", **values)
        if sigma > _MAX_ENCODER_SIGMA
        else None
    )


def _framing_errors(profile: TableProfile, lines: TextSection) -> Iterator[EntryError]:
    for protocol, key in _FRAMING.items():
        rule = needs if profile.protocol == protocol else excludes
        yield from (with_prefix(error, "text") for error in violations(lines, (rule(_PROTOCOL.format(profile), key),)))
    step, sigma = 10.0**-lines.decimals, profile.accuracy.encoder_sigma_deg
    if step > _MAX_ROUNDING * sigma:
        yield EntryError("profile.angle_too_coarse", "text", "decimals", step=step, sigma=sigma)


def _radians(first: float, second: float) -> tuple[float, float]:
    return float(np.deg2rad(first)), float(np.deg2rad(second))


def _normalised(axis: list[float]) -> tuple[float, float, float]:
    unit = np.asarray(axis) / np.linalg.norm(axis)
    return float(unit[0]), float(unit[1]), float(unit[2])


def load_table_profile(path: Path) -> TableProfile:
    """Read and check a table profile. Raises ConfigurationError with the file, entry and remedy."""
    return load_once(TableProfile, path)
