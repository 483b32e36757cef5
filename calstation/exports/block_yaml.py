"""The subset of YAML that exports use: nested mappings in block style, whose values are JSON."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

_INDENT = 2
#: Numbers such as 1e-05, which readers of YAML 1.1 such as Kalibr take for text, because they lack a decimal point.
_WITHOUT_POINT = re.compile(r"(?<![\w.\"])(-?\d+)(?=e[-+]\d)")


def dump(content: Mapping[str, Any], comment: str) -> bytes:
    """Return the text of nested mappings after a comment of one or more lines; keys need no quotes."""
    lines = [f"# {line}" for line in comment.splitlines()]
    return "\n".join([*lines, *_lines(content, 0), ""]).encode()


def _lines(content: Mapping[str, Any], depth: int) -> Iterator[str]:
    for key, value in content.items():
        start = f"{' ' * _INDENT * depth}{key}:"
        if isinstance(value, Mapping):
            yield start
            yield from _lines(value, depth + 1)
        else:
            text = json.dumps(value)
            yield f"{start} " + (text if isinstance(value, str) else _WITHOUT_POINT.sub(r"\1.0", text))


def load(text: bytes) -> dict[str, Any]:
    """Return the nested mappings of a text written by `dump`. Raises ValueError."""
    root: dict[str, Any] = {}
    levels = [root]
    for line in text.decode().splitlines():
        if line.lstrip().startswith("#") or not line.strip():
            continue
        depth = (len(line) - len(line.lstrip())) // _INDENT
        key, separator, value = line.strip().rpartition(": ") if not line.endswith(":") else (line.strip()[:-1], "", "")
        del levels[depth + 1 :]
        levels[depth][key] = json.loads(value) if separator else {}
        if not separator:
            levels.append(levels[depth][key])
    return root
