"""TDMS files of LabVIEW: the channels of a group, named as in the CSV format or by `[columns]`."""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from calstation.physics import CHANNELS
from calstation.records.columns import unit_of
from calstation.records.foreign.topics import Columns, ForeignFormat, Topic


def _topics(path: Path) -> list[Topic]:
    topics = []
    with _opened(path) as file:
        for group in file.groups():
            channels = {channel.name: channel for channel in group.channels()}
            units = {
                name: unit_of(name, str(each.properties.get("unit_string", ""))) for name, each in channels.items()
            }
            columns = {name: (name, unit) for name, unit in units.items() if unit is not None}
            samples = max(map(len, channels.values()), default=0)
            is_imu = all(name in channels for name in CHANNELS[3:])
            topics.append(Topic(group.name, "group", samples, columns if is_imu else {}))
    return topics


def _read(path: Path, topic: Topic) -> Iterator[Columns]:
    with _opened(path) as file:
        channels = file[topic.name].channels()
        yield {each.name: np.asarray(each[:], np.float64) for each in channels if each.dtype.kind in "fiu"}


def _opened(path: Path) -> Any:
    """Open a file; messages of the library about damaged files are suppressed."""
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    log_manager.set_level(logging.CRITICAL)
    return TdmsFile.open(path)


FORMAT = ForeignFormat("TDMS", (".tdms",), "npTDMS", _topics, _read)
