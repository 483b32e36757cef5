"""Decoding of a byte stream into frames, as a whole or in pieces."""

import numpy as np

from calstation.devices.imu import FrameDecoder
from calstation.devices.imu.binary_frames import Columns
from calstation.devices.imu.frames import Frames
from calstation.devices.profiles import FrameSection


def decode(frame: FrameSection, data: bytes, cut: int = 0) -> tuple[FrameDecoder, Frames]:
    """Decode the data as a whole, or in pieces of `cut` bytes."""
    decoder = FrameDecoder(frame)
    pieces = [data[i : i + cut] for i in range(0, len(data), cut)] if cut else [data]
    return decoder, join([decoder.feed(piece).frames for piece in pieces])


def join(parts: list[Frames]) -> Frames:
    """Concatenate frames of one decoder."""
    names = parts[0].columns.values
    values = {name: np.concatenate([part.columns.values[name] for part in parts]) for name in names}
    present = {name: np.concatenate([part.columns.present[name] for part in parts]) for name in names}
    return Frames(tuple(packet for part in parts for packet in part.raw), Columns(values, present))
