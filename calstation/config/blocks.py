"""Blocks of lines in a TOML text, which allow tables to be added, removed or moved together with their comments."""

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from itertools import pairwise
from typing import Any

import tomlkit

from calstation.parsing import parse_toml
from calstation.schema import KeyPath


@dataclass(frozen=True, eq=False)
class _Block:
    """The comments directly above the header of a table, the header, and the lines up to the next block.

    A block whose `path` is None contains the text before the first header, a comment on several tables, or comments
    after an empty line at the end of a table, unless the next entry of the same list follows.
    """

    path: KeyPath | None  #: Keys in the header; the number of an entry follows the key of a list of tables.
    lines: tuple[str, ...]

    def inside(self, path: KeyPath) -> bool:
        """Return whether the block belongs to the table at a path, or to one of its subtables."""
        return self.path is not None and self.path[: len(path)] == path

    @property
    def content(self) -> tuple[str, ...]:
        """Lines of the block without trailing empty lines."""
        return self.lines[: max((i for i, line in enumerate(self.lines, 1) if line.strip()), default=0)]

    @property
    def is_comment(self) -> bool:
        """Whether the block is empty or contains only comments."""
        return all(line.startswith("#") for line in self.lines)


def has_table(text: str, path: KeyPath) -> bool:
    """Return whether a text has a header for the table or the entry of a list of tables at a path."""
    return any(block.path == path for block in _blocks(text))


def remove_table(text: str, path: KeyPath) -> str:
    """Remove a table that has a header, its subtables, and the comments directly above it."""
    blocks = _blocks(text)
    return _text([block for block in blocks if not block.inside(path)], blocks)


def add_table(text: str, path: KeyPath, values: Mapping[str, Any]) -> str:
    """Add a table with a header after the last table with the same first key, or at the end."""
    blocks = _blocks(text)
    last = max((i for i, block in enumerate(blocks, 1) if block.inside(path[:1])), default=len(blocks))
    return _text([*blocks[:last], _new_block(nested(path, values)), *blocks[last:]], blocks)


def nested(keys: KeyPath, value: Any) -> Any:
    """Return a value inside dictionaries with these keys, the outermost first."""
    for key in reversed(keys):
        value = {key: value}
    return value


def add_value(text: str, path: KeyPath, key: str, value: Any) -> str:
    """Add a value at the end of a table that has a header."""
    blocks = _blocks(text)
    number = next(i for i, block in enumerate(blocks) if block.path == path)
    block = blocks[number]
    lines = (*_with_line_breaks(block.content), tomlkit.dumps({key: value}), *block.lines[len(block.content) :])
    return "".join(
        line for each in (*blocks[:number], replace(block, lines=lines), *blocks[number + 1 :]) for line in each.lines
    )


def replace_header(text: str, path: KeyPath, header: str, first: Mapping[str, Any]) -> str:
    """Replace the header of a table and of its subtables, and insert values at the top of the table.

    Parameters
    ----------
    text : TOML text
    path : key path of the table
    header : new header, with brackets
    first : values to insert at the top of the table
    """
    lines: list[str] = []
    for block in _blocks(text):
        if block.path is None or not block.inside(path):
            lines += block.lines
            continue
        number = next(i for i, line in enumerate(block.lines) if line.lstrip().startswith("["))
        key, below = header.strip("[]"), block.path[len(path) :]
        replacement = f"[{'.'.join((key, *map(str, below)))}]" if below else header
        values = () if below or not first else (tomlkit.dumps(first),)
        written = re.sub(r"\[+[^\]]*\]+", replacement, block.lines[number], count=1)
        lines += (*block.lines[:number], *_with_line_breaks((written,)), *values, *block.lines[number + 1 :])
    return "".join(lines)


def arrange_entries(text: str, key: str, order: Sequence[int | Mapping[str, Any]]) -> str:
    """Arrange the entries of a list of tables in the given order.

    An existing entry keeps its lines and the comments directly above it. A list in brackets is converted to tables with
    headers; the comments inside the brackets are removed.

    Parameters
    ----------
    text : TOML text
    key : key of the list
    order : number of each existing entry and values of each new entry, in the new order
    """
    blocks = _blocks(text)
    entries = [block for block in blocks if block.inside((key,))]
    if not entries:
        present = parse_toml(text).get(key, [])
        document = tomlkit.parse(text)
        document.pop(key, None)
        order = [present[entry] if isinstance(entry, int) else entry for entry in order]
        blocks = _blocks(tomlkit.dumps(document))
    first = blocks.index(entries[0]) if entries else len(blocks)
    arranged: list[_Block] = []
    for entry in order:
        if isinstance(entry, int):
            arranged += [block for block in entries if block.inside((key, entry))]
        else:
            arranged.append(_new_block({key: [entry]}))
    remaining = [block for block in blocks[first:] if block not in entries]
    return _text([*blocks[:first], *arranged, *remaining], blocks)


def _blocks(text: str) -> list[_Block]:
    """Split a valid TOML text into blocks, which together contain all its lines."""
    lines = StringIO(text).readlines()
    headers = [i for i, line in enumerate(lines) if line.lstrip().startswith("[") and _is_toml(lines[:i])]
    starts = [_comment_start(lines, i) for i in headers]
    paths = _paths(lines[i] for i in headers)
    blocks = [_Block(None, tuple(lines[: starts[0] if starts else len(lines)]))]
    for n, (path, start, header) in enumerate(zip(paths, starts, headers, strict=True)):
        end = starts[n + 1] if n + 1 < len(starts) else len(lines)
        same_key = [k for k, other in enumerate(paths) if other[0] == path[0]]
        if n == same_key[0] and len(same_key) > 1 and all(starts[k] == headers[k] for k in same_key[1:]):
            blocks.append(_Block(None, tuple(lines[start:header])))  # a single comment refers to all entries
            start = header
        last = n + 1 == len(paths) or paths[n + 1][0] != path[0]
        table_end = _table_end(lines, header, end) if last else end
        blocks.append(_Block(path, tuple(lines[start:table_end])))
        if table_end < end:
            blocks.append(_Block(None, tuple(lines[table_end:end])))
    return blocks


def _table_end(lines: Sequence[str], header: int, end: int) -> int:
    """Return the end of a table, excluding comments that follow an empty line at its end."""
    last = end
    while last > header + 1 and (not lines[last - 1].strip() or lines[last - 1].lstrip().startswith("#")):
        last -= 1
    last = next((i for i in range(last, end) if not lines[i].strip()), end)
    return next((i for i in range(last, end) if lines[i].strip()), end)


def _comment_start(lines: Sequence[str], header: int) -> int:
    """Return the number of the first comment line directly above a header."""
    while header > 0 and lines[header - 1].lstrip().startswith("#"):
        header -= 1
    return header


def _paths(headers: Iterable[str]) -> list[KeyPath]:
    """Return the paths of headers in the order of a file."""
    paths: list[KeyPath] = []
    counts: dict[tuple[str, ...], int] = {}
    for header in headers:
        keys: tuple[str, ...] = ()
        inner = parse_toml(header)
        path: list[str | int] = []
        while inner:
            ((key, inner),) = inner.items()
            keys = (*keys, key)
            path.append(key)
            if isinstance(inner, list):
                counts = {other: n for other, n in counts.items() if other == keys or other[: len(keys)] != keys}
                counts[keys] = counts.get(keys, -1) + 1
                inner = {}
            if keys in counts:
                path.append(counts[keys])
        paths.append(tuple(path))
    return paths


def _is_toml(lines: Sequence[str]) -> bool:
    """Return whether lines are valid TOML, so that the next line is not inside a list or a multi-line text."""
    try:
        parse_toml("".join(lines))
    except tomllib.TOMLDecodeError:
        return False
    return True


def _new_block(data: Mapping[str, Any]) -> _Block:
    return _Block(None, tuple(tomlkit.dumps(data).splitlines(keepends=True)))


def _with_line_breaks(lines: Sequence[str]) -> tuple[str, ...]:
    """End every line with a line break."""
    return tuple(line if line.endswith("\n") else f"{line}\n" for line in lines)


def _text(blocks: Sequence[_Block], before: Sequence[_Block]) -> str:
    """Return the text of blocks, with an empty line between blocks that were not adjacent before."""
    neighbours = set(pairwise(before))
    lines: list[str] = []
    for block, following in zip(blocks, (*blocks[1:], None), strict=True):
        if following is None:
            lines += block.lines if block is before[-1] else block.content
        elif (block, following) in neighbours or block.is_comment:
            lines += block.lines
        else:
            lines += (*_with_line_breaks(block.content), *(block.lines[len(block.content) :] or ("\n",)))
    return "".join(lines)
