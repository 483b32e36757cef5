"""Storing measured noise in an IMU profile."""

from collections.abc import Mapping

import tomlkit

from calstation.config import library, versions
from calstation.config.editing import read_text
from calstation.config.versions import Version
from calstation.jobs import ProgressCallback
from calstation.physics import NOISE_DISPLAY


def save_noise(
    report: ProgressCallback, profile: str, values: Mapping[str, float], source: str, author: str
) -> Version:
    """Job: save entries of `[noise]`, SI, as a new version of an IMU profile; a comment names their `source`.

    Raises ConfigurationError if there is no such profile, or it would be invalid or cannot be written.
    """
    report(0.0)
    document = tomlkit.parse(read_text(library.find("imus", profile)))
    noise = document["noise"]
    assert isinstance(noise, tomlkit.items.Table)
    for name, value in values.items():
        unit, shown, size = NOISE_DISPLAY[name]
        noise[name] = float(f"{value:.4g}")
        noise[name].comment(f"{unit}, {value / size:.4g} {shown}, {source}")
    return versions.save("imus", profile, tomlkit.dumps(document), author)
