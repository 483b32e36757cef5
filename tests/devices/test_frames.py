"""Frames decode completely and identically however the stream is split, with noise and losses."""

import itertools
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from fastcrc import crc16
from hypothesis import given
from hypothesis import strategies as st

from calstation.devices.codecs import CRC_WIDTHS, Reply, check_bytes
from calstation.devices.imu import frame_decoder
from calstation.devices.imu.drivers.framed import command_frame
from calstation.devices.profiles import ImuProfile, load_imu_profile

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture(scope="module")
def profile() -> ImuProfile:
    return load_imu_profile(DATA / "imus" / "bench_nav.toml")


def stream_frame(counter: int, channels: list[int], temperature: int = 2512, status: int = 1) -> bytes:
    body = struct.pack("<H6ihH", counter & 0xFFFF, *channels, temperature, status)
    return b"\x55\xaa" + body + struct.pack("<H", crc16.ibm_3740(body))


def reply_frame(op: int, payload: bytes) -> bytes:
    body = bytes([op, len(payload)]) + payload
    return b"\x55\x5a" + body + struct.pack("<H", crc16.ibm_3740(body))


def decode(profile: ImuProfile, parts: list[bytes]) -> tuple[bytes, list[Reply], int, int]:
    decoder = frame_decoder(profile)
    frames, replies = b"", []
    for part in parts:
        decoded = decoder.feed(part)
        frames += b"".join(decoded.frames.raw)
        replies += decoded.replies
    return frames, replies, decoder.crc_errors, decoder.skipped


def test_frame_is_decoded_by_its_profile(profile: ImuProfile) -> None:
    decoder = frame_decoder(profile)
    data = stream_frame(65535, [1, -2, 3, -(2**31), 5, 2**31 - 1]) + stream_frame(0, [0] * 6, -512, 3)
    counter, counts, temperature, status = decoder.samples(decoder.feed(data).frames)
    assert counter.tolist() == [65535, 0]
    assert counts[0].tolist() == [1, -2, 3, -(2**31), 5, 2**31 - 1]
    assert temperature.tolist() == [25.12, -5.12]
    assert status.tolist() == [1, 3]


def test_checksums_match_known_values() -> None:
    text = b"123456789"
    assert check_bytes("crc16_ccitt_false", text, "big") == b"\x29\xb1"
    assert check_bytes("crc16_xmodem", text, "little") == b"\xc3\x31"
    assert check_bytes("crc16_modbus", text, "big") == b"\x4b\x37"
    assert check_bytes("crc32", text, "big") == b"\xcb\xf4\x39\x26"
    assert check_bytes("crc32_mpeg2", text, "big") == b"\x03\x76\xe6\xe7"
    assert set(CRC_WIDTHS.values()) == {2, 4}


def test_command_frame_matches_the_protocol(profile: ImuProfile) -> None:
    frame = command_frame(profile.commands, profile.frame, 2, b"\x03\x00\x09")
    assert frame == bytes.fromhex("55A5 0203 030009") + struct.pack("<H", crc16.ibm_3740(frame[2:-2]))


piece = st.one_of(
    st.tuples(
        st.just("frame"), st.integers(0, 2**16 - 1), st.lists(st.integers(-(2**31), 2**31 - 1), min_size=6, max_size=6)
    ),
    st.tuples(st.just("reply"), st.integers(0, 255), st.binary(max_size=40)),
    st.tuples(st.just("noise"), st.just(0), st.one_of(st.binary(max_size=50), st.just(b"\x55\xaa"), st.just(b"\x55"))),
)


@given(
    pieces=st.lists(piece, max_size=12),
    cuts=st.lists(st.integers(0, 600), max_size=12),
    flip=st.none() | st.integers(0, 400),
)
def test_result_does_not_depend_on_how_the_stream_is_split(
    profile: ImuProfile, pieces: list[tuple[str, int, object]], cuts: list[int], flip: int | None
) -> None:
    data = bytearray()
    for kind, number, content in pieces:
        if kind == "frame":
            data += stream_frame(number, content)  # type: ignore[arg-type]
        elif kind == "reply":
            data += reply_frame(number, content)  # type: ignore[arg-type]
        else:
            data += content  # type: ignore[operator]
    if flip is not None and flip < len(data):
        data[flip] ^= 0x10
    stream = bytes(data)
    edges = [0, *sorted(c for c in cuts if c < len(stream)), len(stream)]
    whole = decode(profile, [stream])
    assert decode(profile, [stream[a:b] for a, b in itertools.pairwise(edges)]) == whole
    assert decode(profile, [stream[i : i + 1] for i in range(len(stream))]) == whole


@given(noise=st.binary(max_size=80).filter(lambda b: b"\x55" not in b), drop=st.integers(0, 33), at=st.integers(0, 9))
def test_valid_frames_are_decoded_despite_noise_and_a_lost_byte(
    profile: ImuProfile, noise: bytes, drop: int, at: int
) -> None:
    frames = [stream_frame(i, [i] * 6) for i in range(10)]
    hurt = frames[at][:drop] + frames[at][drop + 1 :]
    stream = noise + b"".join([*frames[:at], hurt, *frames[at + 1 :]]) + noise
    found = decode(profile, [stream])[0]
    kept = [frames[i] for i in range(10) if i != at]
    assert all(frame in found for frame in kept)
    assert len(found) == 9 * 34


def test_bytes_outside_frames_are_counted(profile: ImuProfile) -> None:
    bad = bytearray(stream_frame(7, [0] * 6))
    bad[10] ^= 1
    _, _, errors, skipped = decode(profile, [b"abc" + bytes(bad) + stream_frame(8, [0] * 6)])
    assert errors == 1
    assert skipped == 3 + 34


def test_decoding_at_2_khz_uses_a_fraction_of_a_core(profile: ImuProfile) -> None:
    decoder = frame_decoder(profile)
    stream = b"".join(stream_frame(i, [i, -i, 0, 1, 2, 98000]) for i in range(20_000))
    begin = time.process_time()
    count = 0
    for k in range(0, len(stream), 340):
        counter, *_ = decoder.samples(decoder.feed(stream[k : k + 340]).frames)
        count += len(counter)
    assert count == 20_000
    assert time.process_time() - begin < 4.0, "ten seconds of samples"
    np.testing.assert_equal(decoder.crc_errors, 0)
