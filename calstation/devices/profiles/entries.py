"""Entry types and a section that several profiles contain."""

from typing import Annotated, Literal, TypeVar

from pydantic import AfterValidator, Field

from calstation.schema import EntryError, StrictModel

LAST_ADDRESS = 0xFFFF

T = TypeVar("T")


def require(value: T, is_valid: object, code: str) -> T:
    """Return a value, or raise EntryError with a code if it is not valid."""
    if not is_valid:
        raise EntryError(code, value=value)
    return value


def hex_bytes(text: str) -> bytes:
    """Convert hexadecimal text, e.g. "55 AA", to bytes; raises EntryError."""
    try:
        return bytes.fromhex(text)
    except ValueError:
        raise EntryError("profile.not_hexadecimal", value=text) from None


def _check_hexadecimal(text: str) -> str:
    hex_bytes(text)
    return text


#: Address of a 16-bit register or a register entry, 0-based.
Address = Annotated[int, Field(ge=0, le=LAST_ADDRESS)]

#: Content of a 16-bit register.
Word = Annotated[int, Field(ge=0, le=0xFFFF)]

#: Bytes in hexadecimal.
HexText = Annotated[str, AfterValidator(_check_hexadecimal)]

#: One or more bytes in hexadecimal.
SyncText = Annotated[str, AfterValidator(lambda text: require(text, hex_bytes(text), "profile.no_sync_bytes"))]

#: A factor other than 0.
Scale = Annotated[float, AfterValidator(lambda scale: require(scale, scale != 0.0, "profile.scale_zero"))]

#: Text that a device's own model name must contain.
ModelName = Annotated[
    str, Field(min_length=1), AfterValidator(lambda model: require(model, model.strip(), "profile.model_blank"))
]


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
