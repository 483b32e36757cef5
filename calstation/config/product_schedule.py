"""Keeps an engineer's schedule in the product's file, as a new version of it with everything else as it was."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calstation.config import library, versions
from calstation.config.editing import edited, read_text
from calstation.config.versions import Version
from calstation.errors import ConfigurationError
from calstation.jobs.queue import ProgressCallback
from procedures import method


def save_schedule(
    tell: ProgressCallback, product: Path, changes: Mapping[str, Mapping[str, Any]], author: str
) -> tuple[Path, Version]:
    """Work for the workshop: write values of stages' schedules into a product, the site's copy of a shipped one.

    Parameters
    ----------
    product : its file
    changes : values by stage and field; None takes a value out, so that the method's own counts
    author : who says so

    Returns
    -------
    The site's file and its new version.

    Raises
    ------
    ConfigurationError
        where the product would be wrong, cannot hold a value, or cannot be written; it is then as it was.
    """
    text = edited(
        read_text(product),
        {
            ("schedule", stage, name): None if value == {} else value
            for stage, values in changes.items()
            for name, value in values.items()
        },
    )
    _check(product, text, changes)
    tell(0.5)
    version = versions.save("products", product.stem, text, author)
    return library.find("products", product.stem), version


def _check(product: Path, text: str, changes: Mapping[str, Mapping[str, Any]]) -> None:
    """A value left out of the file counts as the method's own, which may be another one than meant."""
    stored = tomllib.loads(text).get("schedule", {})
    for stage, values in changes.items():
        model = method(stage).schedule
        for name, value in values.items():
            default = model.model_fields[name].get_default(call_default_factory=True)
            found = stored.get(stage, {}).get(name, default)
            if found != value:
                raise ConfigurationError(
                    f"{product}: schedule.{stage}.{name} cannot be empty in a product, where it means {default};"
                    " give it a value, or leave it empty for this run only"
                )
