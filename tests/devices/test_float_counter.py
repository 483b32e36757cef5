"""A sample counter in floating-point seconds: NovAtel's RAWIMUSA."""

from pathlib import Path

import numpy as np
import pytest
from decoding import decode
from novatel import novatel_check, novatel_line

from calstation.devices.imu import SampleCount
from calstation.devices.profiles import FrameSection, load_imu_profile
from calstation.devices.profiles.frame import check_samples
from calstation.schema import EntryError

FRAME = load_imu_profile(Path(__file__).parents[2] / "data" / "imus" / "novatel_rawimu.toml").frame
#: Lines that real units sent.
REAL = (
    "%RAWIMUSA,1537,361705.645;1537,361705.644826900,00000000,30387,415,-5398,-23039,-18100736,-5117*c01b540c\r\n",
    "%RAWIMUSA,1815,407772.000;1815,407771.985103333,00000077,63811,-6290,6253,7,-31,14*2d2a4cff\r\n",
)


@pytest.mark.parametrize("cut", [0, 7])
def test_recorded_rawimusa_lines_decode(cut: int) -> None:
    decoder, frames = decode(FRAME, "".join(REAL).encode(), cut)
    assert (len(frames), decoder.crc_errors) == (2, 0)
    _, counts, _, status = decoder.samples(frames)
    np.testing.assert_array_equal(counts[1], [14, 31, 7, 6253, 6290, 63811])
    assert status.tolist() == [0, 0x77]
    assert all(f"{novatel_check(line[1:].split('*')[0]):08x}" == line[-10:-2] for line in REAL)


def test_gaps_and_restarts_are_detected_from_the_time() -> None:
    random = np.random.default_rng(1)
    true = np.concatenate([np.arange(0, 400), np.arange(407, 700)])
    seconds = 604_780.0 + 0.01 * true + random.uniform(-3e-4, 3e-4, len(true))
    weeks, seconds = 1815 + (seconds >= 604_800.0), seconds % 604_800.0
    data = "".join(novatel_line(s, w) for s, w in zip(seconds, weeks, strict=True)).encode()
    decoder, frames = decode(FRAME, data, 1000)
    counter = decoder.samples(frames).counter
    count = SampleCount(FRAME)
    seq = np.concatenate([count.feed(part) for part in np.array_split(counter, 50)])
    np.testing.assert_array_equal(seq - seq[0], true)
    assert (count.gaps, count.restarts) == (1, 0)
    assert count.feed(decoder.samples(decode(FRAME, novatel_line(3.0).encode())[1]).counter)[0] == seq[-1] + 2
    assert (count.gaps, count.restarts) == (2, 1)


def test_line_without_a_time_is_not_a_sample() -> None:
    body = "RAWIMUSA,1815,1.0;1815,nan,00000077,63811,-6290,6253,7,-31,14"
    decoder, frames = decode(FRAME, f"%{body}*{novatel_check(body):08x}\r\n".encode())
    assert len(decoder.samples(frames).counter) == 0


def test_float_counter_requires_the_sample_interval() -> None:
    fields = [f.model_dump(exclude_unset=True) for f in FRAME.fields]
    del fields[0]["per_sample"]
    with pytest.raises(EntryError, match="or f32 or f64 with per_sample"):
        check_samples(FrameSection.model_validate({**FRAME.model_dump(exclude_unset=True), "fields": fields}))
