"""A product with a designed schedule in place of its stages."""

import tomllib
from pathlib import Path
from typing import Any

import tomlkit

from calstation.config import Version, edit_toml, library, read_text, versions
from calstation.design.design import STAGE, Design
from calstation.jobs import ProgressCallback
from calstation.schema import KeyPath

#: Suffix of the name of a product with a designed stage.
_DESIGNED = ", designed"
#: Checks that refer to the rests of one stage.
_OF_RESTS = ("improvement_at_rest", "level")


def designed_product(text: str, design: Design) -> str:
    """Return the text of a product file with the designed stage as its only stage.

    Checks of the rests of other stages are removed; checks of gravity at rest and of motion angles apply to the stage.
    """
    data = tomllib.loads(text)
    checks = data.get("checks", {})
    changes: dict[KeyPath, Any] = {
        ("name",): f"{data['name'].removesuffix(_DESIGNED)}{_DESIGNED}",
        ("stages",): [STAGE],
    }
    changes["targets",] = None
    changes |= {("schedule", stage): None for stage in data.get("schedule", {})}
    changes |= {("limits", name, "sigma_below_after"): None for name in data.get("limits", {})}
    changes |= {("checks", name): None for name in _OF_RESTS}
    if "motion_angle" in checks:
        changes["checks", "motion_angle", "stage"] = STAGE
        changes["checks", "motion_angle", "positions"] = None
    if design.gravity_rest is not None:
        changes["checks", "gravity_at_rest", "shortest_rest_s"] = design.gravity_rest
    for key, value in design.schedule().items():
        changes["schedule", STAGE, key] = _lines(value) if key == "moves" else value
    return edit_toml(text, changes)


def save_design(
    report: ProgressCallback, product: Path, name: str, design: Design, author: str
) -> tuple[Path, Version]:
    """Job: save a product with the designed stage under a name in the site's folder; return its file and version.

    Raises ConfigurationError if the product would be invalid or cannot be written.
    """
    text = designed_product(read_text(product), design)
    report(0.5)
    version = versions.save("products", name, text, author)
    return library.find("products", name), version


def _lines(moves: list[list[float]]) -> tomlkit.items.Array:
    """Return an array with a line for every move."""
    array = tomlkit.array()
    array.extend(moves)
    return array.multiline(True)
