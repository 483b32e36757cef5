"""How a unit whose stream precedes its registers is made to stream its output with them applied (`[corrected]`)."""

from pydantic import Field, field_validator

from calstation.devices.profiles.frame import FrameSection
from calstation.schema import StrictModel


class CorrectedSection(StrictModel):
    """`[corrected]`: what shows that the unit makes of its registers what they mean; left out where nothing does.

    stream : what switches that stream on: the byte behind the framed link's op, the value of the Modbus register
    start : the lines that do so on a VectorNav, without $ and check
    frame : where it comes otherwise than the raw one, in the same units and at the same rate
    """

    stream: int | None = Field(default=None, ge=0, le=0xFFFF)
    start: list[str] = Field(default_factory=list)
    frame: FrameSection | None = None

    @field_validator("start")
    @classmethod
    def _lines(cls, start: list[str]) -> list[str]:
        for line in start:
            if not line or not line.isascii() or not line.isprintable() or set(line) & set("$*"):
                raise ValueError(f"{line!r} must be one line of ASCII without $ and check; correct it")
        return start


def check_corrected(
    section: CorrectedSection, protocol: str, order: str, raw: tuple[int, ...] | None
) -> None:
    """Does the section fit the rest of its profile? Raises ValueError naming the entry.

    Parameters
    ----------
    protocol : of the unit's commands
    order : of stream and registers
    raw : values that switch the raw stream on and off; None where the link has no such switch
    """
    if order == "after_registers":
        raise ValueError(
            "[corrected] belongs to a stream before the registers, this one follows them; remove it"
        )
    if protocol == "stream":
        raise ValueError(
            '[corrected] does not belong to protocol = "stream", which takes no command; remove it'
        )
    by_lines = protocol == "vectornav"
    if by_lines != bool(section.start) or by_lines == (section.stream is not None):
        needed, other = ("start", "stream") if by_lines else ("stream", "start")
        raise ValueError(f'corrected: protocol = "{protocol}" takes {needed} and no {other}; correct it')
    if section.stream is None:
        return
    if raw is None:
        raise ValueError("corrected.stream needs modbus.stream, the register that it is written to; add it")
    if section.stream in raw:
        raise ValueError(
            f"corrected.stream = {section.stream} is what the raw stream is switched by; correct it"
        )
    if protocol == "framed" and section.stream > 0xFF:
        raise ValueError(f"corrected.stream = {section.stream} is more than a byte; it must be 2 to 255")
