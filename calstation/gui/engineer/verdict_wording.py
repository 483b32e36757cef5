"""A result's verdict in a word or two: that of a part of the calibration says which part it was."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QCoreApplication

from calstation.gui.text.messages import term


def word_verdict(result: Mapping[str, Any], *, stages: bool = True) -> str:
    """``PASS``, or ``PASS (part: Rate, Six positions)`` where stages of the product were left out.

    stages : name them; else only ``PASS (part)``
    """
    word = term("badge", str(result["outcome"]))
    if not result.get("part") or not result["stages"]:
        return word
    if not stages:
        return QCoreApplication.translate("verdict", "{0} (part)").format(word)
    named = ", ".join(term("stage", stage) for stage in result["stages"])
    return QCoreApplication.translate("verdict", "{0} (part: {1})").format(word, named)
