"""Range and resolution of the channels follow from their data types."""

import tomllib
from typing import Any

import numpy as np

from calstation.config import library
from calstation.devices.profiles import CHANNELS, FrameSection, ImuProfile, channel_range
from calstation.schema import problems_of


def frame(*types: dict[str, Any], **changes: Any) -> FrameSection:
    fields = [{"name": "counter", "type": "u16"}]
    fields += [{"name": name, **more} for name, more in zip(CHANNELS, types, strict=True)]
    section = {
        "sync": "55 AA",
        "byte_order": "little",
        "crc": {"kind": "sum8", "start": 0},
        "fields": fields,
        **changes,
    }
    return FrameSection.model_validate(section)


def test_integer_channels_saturate_at_the_limits_of_their_type() -> None:
    shown = channel_range(
        frame(
            {"type": "i16"},
            {"type": "i24"},
            {"type": "i16", "scale": -0.5},
            {"type": "u16", "offset": -32768},
            {"type": "q12.20"},
            {"type": "i32", "reach": 1000.0},
        )
    )
    np.testing.assert_array_equal(shown.step, [1.0, 1.0, 0.5, 1.0, 2.0**-20, 1.0])
    np.testing.assert_array_equal(shown.low, [-32768, -(2**23), -16383.5, -32768, -2048.0, -1000])
    np.testing.assert_array_equal(shown.high, [32767, 2**23 - 1, 16384, 32767, 2048 - 2.0**-20, 1000])


def test_float_channels_have_no_resolution_and_only_a_stated_range() -> None:
    shown = channel_range(frame({"type": "f32", "reach": 34.9}, *[{"type": "f64"}] * 5))
    np.testing.assert_array_equal(shown.step, np.zeros(6))
    np.testing.assert_array_equal(shown.high, [34.9, *[np.inf] * 5])
    np.testing.assert_array_equal(shown.low, -shown.high)


def test_resolution_of_a_text_channel_is_unknown() -> None:
    shown = channel_range(frame(*[{"type": "f64"}] * 6, format="text", sync="$X"))
    assert np.isinf(shown.step).all()


def test_only_channels_may_state_a_range() -> None:
    path = library.find("imus", "vectornav_vn100")
    text = path.read_text(encoding="utf-8").replace(
        '{ name = "temperature", type = "f32" }', '{ name = "temperature", type = "f32", reach = 80.0 }'
    )
    (found,) = problems_of(ImuProfile, tomllib.loads(text))
    assert found.what.code == "profile.only_of_channels"
    assert found.key_path[0] == "frame"
    assert found.key_path[-1] == "reach"
