"""How long the frames are that a profile describes, for who compares them with an interface document."""

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from calstation.devices.profiles.frame import FrameSection


def frame_size(frame: Mapping[str, Any]) -> tuple[int, bool] | None:
    """Bytes of a frame with all its fields, and whether all frames have as many; None where its section is wrong.

    Parameters
    ----------
    frame : the section `[frame]` as it stands in the file
    """
    try:
        section = FrameSection.model_validate(frame)
    except ValidationError:
        return None
    return section.least_size(), section.format == "binary" and section.length is None
