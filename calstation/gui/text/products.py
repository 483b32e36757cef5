"""Display names of products."""

import re
from pathlib import Path

from calstation.config import library, load_product
from calstation.errors import CalstationError
from calstation.gui.text.messages import say
from calstation.messages import known


def product_text(name: str) -> str:
    """Return the display name of a product, translated for shipped products; `name` is the name in its file."""
    code = f"product_name.{re.sub(r'[^a-z0-9]+', '_', name.lower())}"
    return say(code) if known(code) else name


def offered_products() -> list[tuple[str, Path]]:
    """Return display name and file of each product in the library; equal names are followed by the file name."""
    files = [library.find("products", stem) for stem in library.names("products")]
    names = [_name(file) for file in files]
    return [
        (product_text(name) if names.count(name) == 1 else f"{product_text(name)} ({file.stem})", file)
        for name, file in zip(names, files, strict=True)
    ]


def _name(file: Path) -> str:
    """Return the name in a product file, or the file name if it cannot be read."""
    try:
        return load_product(file)[1].name
    except CalstationError:
        return file.stem
