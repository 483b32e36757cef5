"""Fuzzing targets: every decoder of external bytes and every file reader; each must accept arbitrary input."""

import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import file_targets

from calstation.devices.codecs import number
from calstation.devices.imu import FrameDecoder, RegisterMap, SampleCount, frame_decoder
from calstation.devices.links import RtuReply
from calstation.devices.links.modbus_rtu import replies
from calstation.devices.links.text_link import ChecksummedFraming, PlainFraming, PromptedFraming
from calstation.devices.profiles import FrameSection, load_imu_profile, load_table_profile
from calstation.errors import DeviceFaultError

DATA = Path(__file__).parents[2] / "data"
IMUS = {path.stem: load_imu_profile(path) for path in sorted((DATA / "imus").glob("*.toml"))}

TABLES = {
    path.stem: profile
    for path in sorted((DATA / "tables").glob("*.toml"))
    if (profile := load_table_profile(path)).text is not None
}

#: A text format, of which no profile may be shipped.
TEXT = FrameSection.model_validate(
    {
        "format": "text",
        "sync": "$VNIMU",
        "crc": {"kind": "xor8", "start": 1},
        "max_size": 200,
        "fields": [{"name": "counter", "type": "u32", "prefix": "T"}]
        + [{"name": f"{s}_{a}", "type": "f32"} for s in ("gyro", "accel") for a in "xyz"],
    }
)


def decoder(name: str) -> tuple[FrameDecoder, FrameSection]:
    """Return a new decoder of a shipped profile, or of the text format."""
    if name == "text":
        return FrameDecoder(TEXT), TEXT
    return frame_decoder(IMUS[name]), IMUS[name].frame


def stream(name: str, data: bytes) -> None:
    """Feed a decoder in pieces whose sizes depend on the data; the decoder accounts for every byte."""
    found, frame = decoder(name)
    count = SampleCount(frame)
    size = 1 + (data[0] if data else 0)
    taken = 0
    for k in range(0, len(data), size):
        decoded = found.feed(data[k : k + size])
        taken += sum(len(frame) for frame in decoded.frames.raw) + sum(len(reply.payload) for reply in decoded.replies)
        counter, counts, _, _ = found.samples(decoded.frames)
        assert counts.shape == (len(counter), 6)
        assert len(count.feed(counter)) == len(counter)
        assert len(found._buffer) <= frame.max_size
    assert taken + found.skipped + len(found._buffer) <= len(data)


def lines(name: str, data: bytes) -> None:
    """Search for replies of a text table in arbitrary bytes; each reply consumes some of them."""
    section = TABLES[name].text
    assert section is not None
    plain = PromptedFraming(section) if section.prompt else PlainFraming(section)
    framing = ChecksummedFraming(section, section.checked) if section.checked else plain
    patterns = [re.compile(query.answer) for query in section.queries.values()]
    rest = data
    while (found := framing.reply("STS,0", rest)) is not None:
        words, left = found
        assert len(left) < len(rest)
        rest = left
        for pattern in patterns:
            pattern.search(words)


def numbers(data: bytes) -> None:
    """Read numbers of every type and byte order from arbitrary bytes, and parameters from arbitrary registers."""
    for kind in ("u8", "i16", "i24", "u32", "f32", "f64", "q16.32", "u64"):
        found = number(kind)
        if len(data) >= found.width:
            for order in ("big", "little"):
                found.unpack(data, order)  # type: ignore[arg-type]
    floats = [float(v) for v in data[:24]]
    for profile in IMUS.values():
        entries = RegisterMap(tuple(profile.registers))
        held = {
            e.key: [floats[i % len(floats)] if floats else 0.0 for i in range(len(e.names))] for e in entries.entries
        }
        with suppress(DeviceFaultError):
            entries.decode(held)


def rtu(data: bytes) -> None:
    """Search for Modbus responses in arbitrary bytes: each is valid and follows the previous one without overlap."""
    kind, place = RtuReply(1), 0
    for reply, end in replies(1, data):
        begin = end - len(reply.payload) - 4
        assert begin >= place
        assert kind.is_valid(data[begin:end])
        place = end


TARGETS: dict[str, Callable[[bytes], None]] = {
    f"stream {name}": lambda data, name=name: stream(name, data)  # type: ignore[misc]
    for name in (*IMUS, "text")
} | {
    f"lines {name}": lambda data, name=name: lines(name, data)  # type: ignore[misc]
    for name in TABLES
}
TARGETS["numbers"] = numbers
TARGETS["answers over RTU"] = rtu
TARGETS |= file_targets.TARGETS
"""All targets by name."""
