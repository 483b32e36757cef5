"""The sections of an IMU profile that do not depend on its protocol: stream, noise, status, corrected output."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from calstation.devices.profiles.entries import Word, require
from calstation.devices.profiles.frame import FrameSection
from calstation.schema import StrictModel


def _check_command_line(line: str) -> str:
    is_plain = line and line.isascii() and line.isprintable() and not set(line) & set("$*")
    return require(line, is_plain, "profile.not_a_command_line")


#: Command line of a VectorNav, without $ and checksum.
CommandLine = Annotated[str, AfterValidator(_check_command_line)]


class StreamSection(StrictModel):
    """`[stream]`: meaning of a count; units as in the `[imu]` section of a log.

    order : whether the stream is taken before or after the unit applies its calibration registers
    gyro_quantisation, accel_quantisation : step of the rounding; default: one count, or 0 if the frame has floats
    """

    sample_rate_hz: float = Field(gt=0, le=100_000)
    output: Literal["increment", "rate"]
    gyro_lsb: float = Field(gt=0)
    accel_lsb: float = Field(gt=0)
    gyro_quantisation: float | None = Field(default=None, ge=0)
    accel_quantisation: float | None = Field(default=None, ge=0)
    order: Literal["before_registers", "after_registers"]


class NoiseSection(StrictModel):
    """`[noise]`: random walks in rad/√s and m/s/√s, bias instabilities in rad/s and m/s²."""

    gyro_arw: float = Field(gt=0)
    accel_vrw: float = Field(gt=0)
    gyro_bias_instability: float = Field(default=0.0, ge=0)
    accel_bias_instability: float = Field(default=0.0, ge=0)


class StatusSection(StrictModel):
    """`[status]`: masks of the status word; 0 for a state that the unit does not report."""

    ready: int = Field(default=0, ge=0)
    saturated: int = Field(default=0, ge=0)
    failed: int = Field(default=0, ge=0)


class CorrectedSection(StrictModel):
    """`[corrected]`: how the unit is commanded to stream its output with the registers applied; omitted if it cannot.

    stream : value that starts this stream: the byte after the op of the framed link, or the Modbus register value
    start : lines that start it on a VectorNav, without $ and checksum
    frame : frame of this stream if it differs from the raw one; it has the same units and rate
    """

    stream: Word | None = None
    start: list[CommandLine] = Field(default_factory=list)
    frame: FrameSection | None = None
