"""Formats of exports; a new format needs a module with its `FORMAT` and one entry in `FORMATS`."""

from calstation.exports import ardupilot, c_source, gazebo, kalibr, matlab, px4, ros, vectornav
from calstation.exports.source import ExportFormat

FORMATS: dict[str, ExportFormat] = {
    "kalibr": kalibr.FORMAT,
    "ros": ros.FORMAT,
    "px4": px4.FORMAT,
    "ardupilot": ardupilot.FORMAT,
    "matlab": matlab.FORMAT,
    "c": c_source.FORMAT,
    "vectornav": vectornav.FORMAT,
    "gazebo": gazebo.FORMAT,
}
