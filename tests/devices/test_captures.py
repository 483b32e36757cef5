"""Real byte streams of three manufacturers decode by profile without lost packets and match their references."""

import datetime
import itertools
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from decoding import decode
from hypothesis import given, settings
from hypothesis import strategies as st

from calstation.devices.imu import SampleCount
from calstation.devices.profiles import FrameSection, ImuProfile, load_imu_profile

IMUS = Path(__file__).parents[2] / "data" / "imus"
CAPTURES = Path(__file__).parents[3] / "shared" / "data" / "real" / "serial_captures"
BOARD = CAPTURES.parent / "imu_array" / "exp_1.bin"

pytestmark = pytest.mark.skipif(not CAPTURES.is_dir(), reason=f"no recordings at {CAPTURES}")


def with_fields(profile: ImuProfile, fields: list[dict[str, Any]]) -> FrameSection:
    """Return the frame of a profile with fields for all its content."""
    return FrameSection.model_validate({**profile.frame.model_dump(exclude_unset=True), "fields": fields})


# MicroStrain MIP -----------------------------------------------------------------------------------------------

VECTORS = {"accel": "04", "gyro": "05", "mag": "06", "euler": "0C"}


def mip_reference(data: bytes) -> list[tuple[int, dict[int, bytes]]]:
    """Parse every packet independently; raise on leftover bytes or a wrong checksum."""
    packets, place = [], 0
    while place < len(data):
        assert data[place : place + 2] == b"ue"
        size = data[place + 3] + 6
        a = b = 0
        for byte in data[place : place + size - 2]:
            a = (a + byte) & 0xFF
            b = (b + a) & 0xFF
        assert data[place + size - 2 : place + size] == bytes([a, b])
        fields, at = {}, place + 4
        while at < place + size - 2:
            fields[data[at + 1]] = data[at + 2 : at + data[at]]
            at += data[at]
        packets.append((data[place + 2], fields))
        place += size
    return packets


def test_microstrain_mip_decodes_byte_by_byte() -> None:
    frame = load_imu_profile(IMUS / "microstrain_mip.toml").frame
    data = (CAPTURES / "microstrain_mip" / "mip_data.bin").read_bytes()[:30_000]
    (_, whole), (_, pieces) = decode(frame, data), decode(frame, data, 1)
    assert len(whole) == len(pieces) > 100
    for name, values in whole.columns.values.items():
        np.testing.assert_array_equal(pieces.columns.values[name], values)


@pytest.mark.long
@pytest.mark.parametrize("cut", [17, *(pytest.param(cut, marks=pytest.mark.exhaustive) for cut in (0, 4096))])
def test_microstrain_mip_decodes_and_matches_its_reference(cut: int) -> None:
    data = (CAPTURES / "microstrain_mip" / "mip_data.bin").read_bytes()
    fields: list[dict[str, Any]] = [
        {"name": "counter", "item": "D5", "type": "u64"},
        *({"name": f"{n}_{a}", "item": i, "type": "f32"} for n, i in VECTORS.items() for a in "xyz"),
    ]
    decoder, frames = decode(with_fields(load_imu_profile(IMUS / "microstrain_mip.toml"), fields), data, cut)
    assert (decoder.crc_errors, decoder.skipped) == (0, 0)
    assert len(frames) + decoder.others == 8384
    counts = {name: int(frames.columns.present[f"{name}_x"].sum()) for name in VECTORS}
    assert counts == {"accel": 4473, "gyro": 4473, "mag": 3578, "euler": 1788}
    reference = [packet for set_, packet in mip_reference(data) if set_ == 0x80]
    assert len(frames) == len(reference)
    for name, item in VECTORS.items():
        for k, axis in enumerate("xyz"):
            expected = [struct.unpack(">3f", p[int(item, 16)])[k] for p in reference if int(item, 16) in p]
            found = frames.columns.values[f"{name}_{axis}"][frames.columns.present[f"{name}_{axis}"]]
            np.testing.assert_array_equal(found, expected)


def test_microstrain_samples_have_no_gaps() -> None:
    profile = load_imu_profile(IMUS / "microstrain_mip.toml")
    data = (CAPTURES / "microstrain_mip" / "mip_data.bin").read_bytes()
    decoder, frames = decode(profile.frame, data, 1000)
    counter, counts, _, _ = decoder.samples(frames)
    assert len(counter) == 4473
    count = SampleCount(profile.frame)
    seq = np.concatenate([count.feed(part) for part in np.array_split(counter, 300)])
    stamps = [struct.unpack(">Q", p[0xD5])[0] for s, p in mip_reference(data) if s == 0x80 and 4 in p]
    np.testing.assert_array_equal(counter, stamps)
    np.testing.assert_array_equal(seq, np.rint(np.array(stamps) / 8e6))
    assert count.gaps == 0
    assert np.median(np.linalg.norm(counts[:, 3:], axis=1)) == pytest.approx(1.0, abs=0.03), "gravity, moved about"


# Xsens MTData2 -------------------------------------------------------------------------------------------------

KINDS = {"Float32": ("f32", 0), "FP1220": ("q12.20", 1), "FP1632": ("q16.32", 2), "Float64": ("f64", 3)}
XSENS: dict[str, tuple[int, str]] = {
    "EulerAngles": (0x2030, "XYZ"),
    "Acceleration": (0x4020, "XYZ"),
    "DeltaV": (0x4010, "XYZ"),
    "RateOfTurn": (0x8020, "XYZ"),
    "DeltaQ": (0x8030, "0123"),
    "LatLon": (0x5040, "ab"),
    "AltitudeEllipsoid": (0x5020, "a"),
    "VelocityXYZ": (0xD010, "XYZ"),
    "RotationMatrix": (0x2020, "ABCDEFGHI"),
    "FreeAcceleration": (0x4030, "XYZ"),
    "Quaternion": (0x2010, "0123"),
    "Temperature": (0x0810, "a"),
    "PositionECEF": (0x5030, "XYZ"),
    "MagneticField": (0xC020, "XYZ"),
}
WHOLE = {
    "PacketCounter": (0x1020, "u16"),
    "SampleTimeFine": (0x1060, "u32"),
    "SampleTimeCoarse": (0x1070, "u32"),
    "BaroPressure": (0x3010, "u32"),
    "StatusByte": (0xE010, "u8"),
    "StatusWord": (0xE020, "u32"),
}
CLOCK = [("nano", "u32"), ("year", "u16"), *((n, "u8") for n in ("month", "day", "hour", "minute", "second"))]
GNSS = "ITOW u32,Year u16,Month u8,Day u8,Hour u8,Min u8,Sec u8,Valid u8,TAcc u32,Nano i32,FixType u8,Flags u8"
GNSS += ",NumSV u8,Reserved1 u8,Lon i32,Lat i32,Height i32,HMSL i32,HAcc u32,VAcc u32,VelN i32,VelE i32,VelD i32"
GNSS += ",GSpeed i32,HeadMot i32,SAcc u32,HeadAcc u32,HeadVeh i32,GDOP u16,PDOP u16,TDOP u16,VDOP u16,HDOP u16"
GNSS += ",NDOP u16,EDOP u16"


def xsens_fields(kind: str) -> list[dict[str, Any]]:
    type_, digit = KINDS[kind]
    order = {"word_order": "fraction_first"} if kind == "FP1632" else {}
    fields: list[dict[str, Any]] = [
        {"name": f"{name}.{k}", "item": f"{item + digit:04X}", "type": type_, **order}
        for name, (item, parts) in XSENS.items()
        for k in range(len(parts))
    ]
    fields += [{"name": n, "item": f"{item:04X}", "type": t} for n, (item, t) in WHOLE.items()]
    fields += [{"name": f"UTC.{n}", "item": "1010", "type": t} for n, t in CLOCK]
    for entry in GNSS.split(","):
        name, type_ = entry.split()
        fields.append({"name": f"GNSSPVTData.{name}", "item": "7010", "type": type_})
    fields.append({"name": "GNSSSatInfo.ITOW", "item": "7020", "type": "u32"})
    fields.append({"name": "GNSSSatInfo.NumSVS", "item": "7020", "type": "u8"})
    return fields


def xsens_reference(path: Path) -> list[dict[str, float]]:
    """Return every number of every packet in a decoded text, by the names of `xsens_fields`."""
    packets = []
    for block in re.split(r"\n\s*\n", path.read_text().strip()):
        numbers: dict[str, float] = {}
        heading, part = "", 0
        for line in block.splitlines():
            if not line.startswith(" "):
                heading, part = re.split(r"[(:]", line)[0], 0
                continue
            text = line.strip()
            if heading in ("StatusByte", "StatusWord"):
                numbers[heading] = int(text, 2)
            elif heading in WHOLE:
                numbers[heading] = int(text)
            elif heading == "UTCTime":
                whole, _, fraction = text.rstrip("Z").partition(".")
                moment = datetime.datetime.fromisoformat(whole)
                names = ("year", "month", "day", "hour", "minute", "second")
                numbers |= {f"UTC.{n}": getattr(moment, n) for n in names}
                numbers["UTC.nano"] = int(fraction.ljust(9, "0") or 0)
            elif heading.startswith("GNSS"):
                name, _, value = text.partition(":")
                if heading == "GNSSPVTData" or name in ("ITOW", "NumSVS"):
                    numbers[f"{heading}.{name}"] = int(value)
            else:
                numbers[f"{heading}.{part}"] = float(text.split(":")[-1])
                part += 1
        packets.append(numbers)
    return packets


@pytest.mark.long
@pytest.mark.parametrize("cut", [1, *(pytest.param(cut, marks=pytest.mark.exhaustive) for cut in (0, 333))])
@pytest.mark.parametrize(
    ("folder", "kind"), [("1", "Float32"), ("2", "FP1220"), ("3", "FP1632"), ("4", "Float64"), ("5", "Float32")]
)
def test_xsens_mtdata2_decodes_and_matches_its_reference(folder: str, kind: str, cut: int) -> None:
    place = CAPTURES / "xsens_mtdata2" / folder
    frame = with_fields(load_imu_profile(IMUS / "xsens_mtdata2.toml"), xsens_fields(kind))
    decoder, frames = decode(frame, (place / "output.bin").read_bytes(), cut)
    assert (decoder.crc_errors, decoder.skipped, decoder.others) == (0, 0, 0)
    assert len(frames) == 100
    reference = xsens_reference(place / "output.golden")
    assert len(reference) == 100
    columns = frames.columns
    for row, expected in enumerate(reference):
        found = {n: columns.values[n][row] for n in columns.values if columns.present[n][row]}
        assert set(found) == set(expected)
        for name, value in expected.items():
            assert found[name] == pytest.approx(value, rel=1e-15, abs=0), (row, name)


def test_other_packets_between_xsens_samples_cause_no_gap() -> None:
    profile = load_imu_profile(IMUS / "xsens_mtdata2.toml")
    data = (CAPTURES / "xsens_mtdata2" / "1" / "output.bin").read_bytes()
    decoder, frames = decode(profile.frame, data, 100)
    counter, counts, temperature, status = decoder.samples(frames)
    assert len(counter) == 96
    count = SampleCount(profile.frame)
    assert np.all(np.diff(count.feed(counter)) == 1)
    assert count.gaps == 0
    assert np.all(np.isnan(temperature))
    assert status[0] == 0b1100000000000000000000111
    assert np.linalg.norm(counts[50, 3:]) == pytest.approx(9.8, abs=0.1)


# STIM300 and a laboratory board ---------------------------------------------------------------------------------


def test_stim300_datagram_decodes_and_matches_its_reference() -> None:
    profile = load_imu_profile(IMUS / "stim300.toml")
    data = (CAPTURES / "stim300_one_datagram" / "datagram_full.bin").read_bytes()
    body = (CAPTURES / "stim300_one_datagram" / "datagram_body_59B.bin").read_bytes()
    assert profile.frame.crc.function()(body) == 3326689990
    decoder, frames = decode(profile.frame, data + data, 7)
    assert (len(frames), decoder.crc_errors, decoder.skipped) == (2, 0, 0)
    counter, counts, temperature, status = decoder.samples(frames)
    assert counter.tolist() == [225, 225]
    gyro, accel = counts[0, :3] / 2**14, counts[0, 3:] / 2**19
    np.testing.assert_allclose(gyro, [0.0178223, -0.0806885, 0.0524292], atol=5e-8)
    np.testing.assert_allclose(accel, [-0.0118904, -0.0169868, 1.0138283], atol=5e-8)
    assert profile.stream.gyro_lsb == pytest.approx(np.deg2rad(2.0**-14), rel=1e-12)
    assert profile.stream.accel_lsb == pytest.approx(9.80665 * 2.0**-19, rel=1e-12)
    assert temperature[0] == pytest.approx(0x23A0 / 256)
    assert status[0] == 0


def test_crc_detects_every_flipped_bit_of_a_stim300_datagram() -> None:
    profile = load_imu_profile(IMUS / "stim300.toml")
    named = profile.frame.model_dump(exclude_unset=True)
    crc = {"kind": "crc", "width": 32, "polynomial": 0x04C11DB7, "initial": 0xFFFFFFFF, "start": 0, "pad": 1}
    frame = FrameSection.model_validate({**named, "crc": crc})
    data = (CAPTURES / "stim300_one_datagram" / "datagram_full.bin").read_bytes()
    assert len(decode(frame, data)[1]) == 1
    for place, bit in itertools.product(range(len(data)), range(8)):
        hurt = bytearray(data)
        hurt[place] ^= 1 << bit
        assert len(decode(frame, bytes(hurt) + data)[1]) == 1, "only the sound one behind it"


@pytest.mark.skipif(not BOARD.is_file(), reason=f"no recording at {BOARD}")
def test_board_of_eight_imus_with_an_additive_checksum_decodes() -> None:
    names = [f"{sensor}_{axis}" for sensor in ("accel", "gyro") for axis in "xyz"]
    fields = [{"name": n, "type": t} for n, t in (("counter", "u16"), ("spare_length", "u8"), ("clock", "u32"))]
    fields += [{"name": f"{name}_{k}", "type": "i16"} for k in range(8) for name in names]
    crc = {"kind": "sum16", "start": 0}
    frame = FrameSection.model_validate({"sync": "AA", "byte_order": "big", "fields": fields, "crc": crc})
    data = BOARD.read_bytes()
    decoder, frames = decode(frame, data, 10_000)
    assert decoder.skipped == 4, "the acknowledgement before the first packet"
    assert decoder.crc_errors == 0
    assert len(frames) == (len(data) - 4) // 106 == 37439
    counter = frames.columns.values["counter"]
    assert np.all(np.diff(counter) % 65536 == 1)
    force = np.hypot(np.hypot(*(frames.columns.values[f"accel_{a}_0"][:100] / 2048 for a in "xy")),
                     frames.columns.values["accel_z_0"][:100] / 2048)  # fmt: skip
    assert force.mean() == pytest.approx(1.0, abs=0.05)


# Noise between real packets ---------------------------------------------------------------------------------------


def recordings() -> list[tuple[str, Path]]:
    found = [("microstrain_mip", CAPTURES / "microstrain_mip" / "mip_data.bin")]
    found += [("xsens_mtdata2", CAPTURES / "xsens_mtdata2" / "1" / "output.bin")]
    return [*found, ("stim300", CAPTURES / "stim300_one_datagram" / "datagram_full.bin")]


@pytest.mark.parametrize("which", range(3), ids=["mip", "mtdata2", "stim300"])
# The noise is always the same, because a checksum of one byte accepts some random noise in the long run.
@settings(derandomize=True)
@given(data=st.data())
def test_valid_packets_are_found_after_arbitrary_noise(which: int, data: st.DataObject) -> None:
    name, path = recordings()[which]
    frame = load_imu_profile(IMUS / f"{name}.toml").frame
    stream = path.read_bytes()[:4000]
    sound = decode(frame, stream)[1].raw * (1 if which < 2 else 12)
    packets = [data.draw(st.sampled_from(sound)) for _ in range(12)]
    hurt = data.draw(st.sets(st.integers(0, 11), max_size=5))
    sent, kept = b"", []
    for i, packet in enumerate(packets):
        sent += data.draw(st.binary(max_size=12))
        if i in hurt:
            place = data.draw(st.integers(0, len(packet) - 1))
            sent += packet[:place] + bytes([packet[place] ^ data.draw(st.integers(1, 255))]) + packet[place + 1 :]
        else:
            sent += packet
            kept.append(packet)
    # Enough data follow for any length in the noise, so that the decoder never waits for more.
    decoder, frames = decode(frame, sent + bytes(frame.max_size), data.draw(st.integers(0, 60)))
    found = list(frames.raw)
    assert all(packet in found for packet in kept)
    assert len(found) >= len(kept)
    assert len(found) + decoder.others <= 12 + 2, "noise passes a check of one byte now and then, and not more"
