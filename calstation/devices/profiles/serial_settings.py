"""Settings of a serial port: defaults in a profile, or the values of a station in its file."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from calstation.devices.profiles.entries import require
from calstation.schema import StrictModel


class SerialSettings(StrictModel):
    """Settings of a serial port; `write_timeout_s` is the timeout for sending a command, host time in s."""

    baud: int = Field(default=115200, ge=50, le=12_000_000)
    data_bits: Literal[5, 6, 7, 8] = 8
    parity: Literal["N", "E", "O", "M", "S"] = "N"
    stop_bits: Annotated[
        float, AfterValidator(lambda bits: require(bits, bits in (1, 1.5, 2), "profile.stop_bits"))
    ] = 1
    write_timeout_s: float = Field(default=1.0, gt=0, le=60)

    @property
    def line(self) -> str:
        """The usual notation, e.g. ``921600 8N1``."""
        return f"{self.baud} {self.data_bits}{self.parity}{self.stop_bits:g}"

    @property
    def bits_per_byte(self) -> float:
        """Bits on the line for each byte, including start, parity and stop bits."""
        return 1 + self.data_bits + (self.parity != "N") + self.stop_bits
