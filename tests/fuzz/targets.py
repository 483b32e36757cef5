"""What is fuzzed: every decoder of bytes that come from outside, each a function of bytes that must bear anything."""

from collections.abc import Callable
from pathlib import Path

from calstation.devices.frame_profile import FrameSection
from calstation.devices.frames import FrameDecoder
from calstation.devices.imu_profile import load_imu_profile
from calstation.devices.sample_count import SampleCount

DATA = Path(__file__).parents[2] / "data"
IMUS = {path.stem: load_imu_profile(path) for path in sorted((DATA / "imus").glob("*.toml"))}

TEXT = FrameSection.model_validate(
    {
        "format": "text",
        "sync": "$VNIMU",
        "crc": {"kind": "xor8", "start": 1},
        "max_size": 200,
        "fields": [{"name": "counter", "type": "u32", "prefix": "S"}]
        + [{"name": f"{s}_{a}", "type": "f32"} for s in ("gyro", "accel") for a in "xyz"],
    }
)
"""A text format, of which no profile may be shipped."""


def decoder(name: str) -> tuple[FrameDecoder, FrameSection]:
    """A fresh decoder of a shipped profile, or of the text format."""
    if name == "text":
        return FrameDecoder(TEXT), TEXT
    profile = IMUS[name]
    return FrameDecoder(profile.frame, profile.commands), profile.frame


def stream(name: str, data: bytes) -> None:
    """Feed a decoder in pieces whose sizes the data choose; whatever comes, it accounts for every byte."""
    found, frame = decoder(name)
    count = SampleCount(frame)
    size = 1 + (data[0] if data else 0)
    taken = 0
    for k in range(0, len(data), size):
        decoded = found.feed(data[k : k + size])
        taken += len(decoded.frames.tobytes()) + sum(len(reply.payload) for reply in decoded.replies)
        counter, counts, _, _ = found.samples(decoded.frames)
        assert counts.shape == (len(counter), 6)
        assert len(count.feed(counter)) == len(counter)
        assert len(found._buffer) <= frame.max_size
    assert taken + found.skipped + len(found._buffer) <= len(data)


TARGETS: dict[str, Callable[[bytes], None]] = {
    f"stream {name}": lambda data, name=name: stream(name, data)  # type: ignore[misc]
    for name in (*IMUS, "text")
}
"""All targets by name."""
