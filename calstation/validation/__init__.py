"""Validation of an installation on its computer before use and after changes, as ISO/IEC 17025:2017, 7.11, requires."""

from typing import TYPE_CHECKING, Any

from calstation.validation.lines import Line
from calstation.validation.report import (
    Validation,
    compare,
    differences,
    find_validation_due,
    read_validation,
    save_validation,
    validation_due,
)

if TYPE_CHECKING:
    from calstation.validation.document import line_name, line_texts, row_text, write_documents
    from calstation.validation.references import ANSWERS, answer_of
    from calstation.validation.run import validate_installation

#: Modules of the names that are imported on first use, because they load the engine and the virtual bench.
_MODULES = {
    **dict.fromkeys(("line_name", "line_texts", "row_text", "write_documents"), "document"),
    **dict.fromkeys(("ANSWERS", "answer_of"), "references"),
    "validate_installation": "run",
}


def __getattr__(name: str) -> Any:
    """Import a name on first use, because every run asks whether a validation is due."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
