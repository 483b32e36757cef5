"""Import of a raw capture, which contains the bytes sent by a unit and is decoded with an IMU profile."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calstation.devices.imu import FrameDecoder, SampleCount, frame_decoder
from calstation.devices.profiles import ImuProfile, channel_range, load_imu_profile
from calstation.errors import InputError
from calstation.estimation.common import SampleBlock
from calstation.messages import os_reason
from calstation.records import LogFacts, RecordingMeta, SiteSection, write_log
from calstation.schema import read_toml, validate

#: Number of bytes decoded at a time.
_CHUNK = 1 << 18


@dataclass(frozen=True)
class Capture:
    """Contents of a raw capture."""

    facts: LogFacts
    has_site: bool  #: Whether the TOML has a section `[site]`.
    failed: int  #: Number of packets with a wrong checksum.
    skipped: int  #: Number of bytes outside packets.


def import_capture(source: Path, target: Path, imu: Path, meta_file: Path | None, site: SiteSection) -> Capture:
    """Decode a capture and write it to a raw log. Raises InputError or ConfigurationError.

    Parameters
    ----------
    source, target : capture and raw log
    imu : IMU profile
    meta_file : TOML file, by default next to the capture, whose sections `[site]`, `[imu]` and `[prior]` override the
        site and the profile
    site : default site
    """
    beside = source.with_suffix(".toml")
    profile = load_imu_profile(imu)
    meta_file = meta_file or (beside if beside.is_file() else None)
    data = {} if meta_file is None else read_toml(meta_file, InputError)
    has_site = "site" in data
    meta = validate(RecordingMeta, _with_defaults(data, profile, source, site), meta_file or source, InputError)
    decoder = frame_decoder(profile)
    facts = write_log(target, meta.log_meta, _blocks(source, profile, decoder, meta.stage))
    return Capture(facts, has_site, decoder.crc_errors, decoder.skipped)


def _with_defaults(data: dict[str, Any], profile: ImuProfile, source: Path, site: SiteSection) -> dict[str, Any]:
    """Return the content of a TOML file, completed by the profile and the site."""
    known = {**profile.stream.model_dump(exclude={"order"}), **profile.noise.model_dump()}
    known["serial"] = source.stem
    prior = {name: {"sigma": sigma} for name, sigma in profile.prior_sigmas().items()}
    data = {"site": site.model_dump(exclude_none=True), **data}
    for section, values in (("imu", known), ("prior", prior)):
        if isinstance(entries := data.get(section, {}), dict):
            data[section] = {**values, **entries}
    return data


def _blocks(source: Path, profile: ImuProfile, decoder: FrameDecoder, stage: str) -> Iterator[SampleBlock]:
    """Decode a file; saturated and non-numeric samples are marked as invalid. Raises InputError."""
    count, bounds, rate = SampleCount(profile.frame), channel_range(profile.frame), profile.stream.sample_rate_hz
    size = 0
    try:
        with source.open("rb") as stream:
            while data := stream.read(_CHUNK):
                size += len(data)
                raw, counts, temperature, status = decoder.samples(decoder.feed(data).frames)
                order = count.in_order(raw)
                if not len(order):
                    continue
                seq, counts = count.feed(raw[order]), counts[order]
                saturated = (status[order] & profile.status.saturated) != 0
                saturated |= ((counts <= bounds.low) | (counts >= bounds.high)).any(axis=1)
                yield SampleBlock(
                    stage,
                    seq,
                    (seq + 1) / rate,
                    counts,
                    np.full((len(seq), 2), np.nan),
                    np.zeros(len(seq), np.int64),
                    ~saturated & np.isfinite(counts).all(axis=1),
                    temperature[order],
                )
    except OSError as exc:
        raise InputError("log.unreadable", file=source, reason=os_reason(exc)) from exc
    if count.last is None:
        failed = decoder.crc_errors
        raise InputError("log.no_frames", file=source, profile=profile.name, bytes=size, failed=failed)
