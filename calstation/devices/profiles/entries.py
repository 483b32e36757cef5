"""Entry types that are used in several sections of profiles."""

from typing import Annotated

from pydantic import AfterValidator, Field

from calstation.schema import EntryError

LAST_ADDRESS = 0xFFFF


def hex_bytes(text: str) -> bytes:
    """Convert hexadecimal text, e.g. "55 AA", to bytes; raises EntryError."""
    try:
        return bytes.fromhex(text)
    except ValueError:
        raise EntryError("profile.not_hexadecimal", value=text) from None


def _check_hexadecimal(text: str) -> str:
    hex_bytes(text)
    return text


def _check_scale(scale: float) -> float:
    if scale == 0.0:
        raise EntryError("profile.scale_zero")
    return scale


def _check_model(model: str) -> str:
    if not model.strip():
        raise EntryError("profile.model_blank")
    return model


#: Address of a 16-bit register or a register entry, 0-based.
Address = Annotated[int, Field(ge=0, le=LAST_ADDRESS)]

#: Content of a 16-bit register.
Word = Annotated[int, Field(ge=0, le=0xFFFF)]

#: Bytes in hexadecimal.
HexText = Annotated[str, AfterValidator(_check_hexadecimal)]

#: A factor other than 0.
Scale = Annotated[float, AfterValidator(_check_scale)]

#: Text that a device's own model name must contain.
ModelName = Annotated[str, Field(min_length=1), AfterValidator(_check_model)]
