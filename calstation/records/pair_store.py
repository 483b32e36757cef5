"""The last cross-calibration of each pair of IMUs, kept as a file of its own that the next one replaces whole."""

import re
from pathlib import Path

import tomli_w

from calstation.errors import ConfigurationError, InputError
from calstation.estimation.common.context import StoredPair
from calstation.records.atomic import write_atomic
from calstation.records.meta import StoredPairSection
from calstation.schema import load


def pair_path(folder: Path, primary: str, secondary: str) -> Path:
    """The file of a pair, by the serial numbers of both."""
    names = [re.sub(r"[^A-Za-z0-9.-]", "-", serial) for serial in (primary, secondary)]
    return folder / f"{names[0]}_{names[1]}.toml"


def load_pair(folder: Path, primary: str, secondary: str) -> StoredPair:
    """What is stored of a pair; nothing where it was never calibrated. Raises InputError on a damaged file."""
    path = pair_path(folder, primary, secondary)
    if not path.exists():
        return StoredPair()
    section = load(StoredPairSection, path, InputError)
    return StoredPair(section.values, section.gyro_static, section.accel_static)


def store_pair(folder: Path, primary: str, secondary: str, stored: StoredPair) -> Path:
    """Put `stored` in place of what was stored before. Raises ConfigurationError where it cannot be written."""
    path = pair_path(folder, primary, secondary)
    shown = {"gyro_static": stored.gyro_static, "accel_static": stored.accel_static}
    content = {**{k: v for k, v in shown.items() if v is not None}, "values": dict(stored.values)}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, tomli_w.dumps(content))
    except OSError as exc:
        raise ConfigurationError(
            f"{path}: cannot be written ({exc.strerror or exc}); choose another folder"
        ) from exc
    return path
