"""Copies of profiles with changes."""

import copy
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def edited(profile: Path | dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of a profile with changes by path, such as ``registers/1/address``; `None` removes an entry."""
    data = tomllib.loads(profile.read_text("utf-8")) if isinstance(profile, Path) else copy.deepcopy(profile)
    for path, value in changes.items():
        *parents, last = path.split("/")
        place: Any = data
        for part in parents:
            place = place[int(part)] if isinstance(place, list) else place[part]
        key: Any = int(last) if isinstance(place, list) else last
        if value is None:
            del place[key]
        else:
            place[key] = value
    return data
