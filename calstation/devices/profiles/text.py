"""The section `[text]` of a table with text commands, which defines the lines and the meaning of the replies."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import combinations, product
from string import Formatter
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field

from calstation.devices.profiles.entries import ProfileSection, Rules, SerialSettings, require
from calstation.errors import DeviceFaultError
from calstation.messages import Text
from calstation.schema import EntryError, Pattern, StrictModel, entry, near_miss

#: Values that the lines of each command may contain in braces besides `axis`, in degrees, °/s and °/s². They may begin
#: with the name of the joint, e.g. `outer_angle`. The first value is required.
_VALUES = {"move": ("angle", "rate", "acceleration"), "rate": ("rate", "acceleration"), "turn": ("angle", "rate")}
#: Pairs of commands whose lines may be equal.
_MAY_BE_EQUAL = ({"disable", "stop"}, {"disable", "reset"}, {"stop", "reset"})
#: Largest code of a character that a line may contain (Latin-1).
_LAST_LETTER = 0xFF
_VARIABLE_FLAGS = ("fault", "moving", "settled", "alarm", "door")


class CommandLines(ProfileSection):
    """`[text.commands]`: the lines of each command in order; a line with {axis} is sent for outer, then for inner."""

    enable: list[str] = Field(min_length=1)
    disable: list[str] = Field(min_length=1)
    home: list[str] = Field(default_factory=list)
    move: list[str] = Field(min_length=1)
    rate: list[str] = Field(default_factory=list)
    stop: list[str] = Field(min_length=1)
    reset: list[str] = Field(min_length=1)
    heartbeat: list[str] = Field(default_factory=list)

    rules: ClassVar[Rules["CommandLines"]] = (
        lambda s: (error for name, lines in s.by_command.items() for error in _line_errors(lines, name)),
        lambda s: (
            EntryError("profile.same_lines", b, other=a)
            for a, b in combinations(s.by_command, 2)
            if s.by_command[a] == s.by_command[b] and {a, b} not in _MAY_BE_EQUAL
        ),
    )

    @property
    def by_command(self) -> dict[str, list[str]]:
        """The lines of each command that has lines."""
        return {name: lines for name, lines in self if lines}


def _line_errors(lines: Sequence[str], command: str) -> Iterator[EntryError]:
    """Yield the errors in the lines of a command, whose first value must be sent for both axes."""
    values, named = _VALUES.get(command, ()), set[str]()
    for i, line in enumerate(lines):
        with entry(command, i):
            named |= check_line(line, values)
    for value, joint in product(values[:1], ("outer", "inner")):
        if value not in named and f"{joint}_{value}" not in named:
            missing = f"{joint}_{value}" if any(name.endswith(f"_{value}") for name in named) else value
            yield EntryError("profile.value_not_sent", command, name=missing)


def check_line(line: str, values: Sequence[str], *, axes: bool = True) -> set[str]:
    """Return the names in braces in a command line, which must be among `values`. Raises EntryError.

    Parameters
    ----------
    line : command line
    values : names of the values that the line may contain
    axes : whether values belong to an axis, so that `axis` and the values of each joint are also allowed
    """
    if not line.isprintable() or any(ord(letter) > _LAST_LETTER for letter in line):
        raise EntryError("profile.line_not_latin", value=line)
    joints = (f"{joint}_{name}" for joint in ("outer", "inner") for name in values)
    known = ("axis", *values, *joints) if axes else tuple(values)
    try:
        parts = list(Formatter().parse(line))
    except ValueError:
        raise EntryError("profile.single_brace", value=line) from None
    braces = set()
    for _, name, form, conversion in parts:
        if name is None:
            continue
        if form or conversion or name not in known:
            written = name + (f"!{conversion}" if conversion else "") + (f":{form}" if form else "")
            otherwise = Text.of("entry.choose_from", names=known)
            remedy = near_miss(name, known, otherwise)
            raise EntryError("profile.unknown_brace", value=line, name=f"{{{written}}}", remedy=remedy)
        braces.add(name)
    for name in sorted(braces & set(values)):
        if axes and "axis" not in braces:
            raise EntryError("profile.value_without_axis", value=line, name=name)
    return braces


def _check_query_line(line: str) -> str:
    check_line(line, ())
    return line


class Query(StrictModel):
    """A query, which is sent once for each axis if it contains {axis}, and the pattern of its reply."""

    send: Annotated[str, Field(min_length=1), AfterValidator(_check_query_line)]
    answer: Annotated[
        Pattern, AfterValidator(lambda text: require(text, re.compile(text).groupindex, "profile.no_named_group"))
    ]

    @property
    def groups(self) -> Mapping[str, int]:
        """Named groups of the pattern."""
        return re.compile(self.answer).groupindex


class Flag(ProfileSection):
    """The source of a status flag, which is a bit or the text of a group in the reply to a query, or a constant."""

    query: str | None = None
    group: str = "value"
    bit: int | None = Field(default=None, ge=0, le=63)
    base: Literal[10, 16] = 10
    matches: str | None = None
    always: bool | None = None

    rules: ClassVar[Rules["Flag"]] = (
        lambda s: [s.bit, s.matches, s.always].count(None) != 2 and EntryError("profile.flag_needs_one_source"),
        lambda s: (s.query is None) != (s.always is not None) and EntryError("profile.flag_needs_query"),
    )

    def is_set(self, groups: Mapping[str, str]) -> bool:
        """Return whether the flag is set in the groups of a reply. Raises DeviceFaultError."""
        if self.always is not None:
            return self.always
        text = groups.get(self.group, "")
        if self.matches is not None:
            return re.search(self.matches, text) is not None
        try:
            return bool(int(text, self.base) >> (self.bit or 0) & 1)
        except ValueError:
            raise DeviceFaultError("table.not_a_number_of_base", answer=text, base=self.base) from None


class Flags(StrictModel):
    """`[text.flags]`: sources of the status flags."""

    enabled: Flag
    homed: Flag
    fault: Flag
    moving: Flag | None = None
    settled: Flag | None = None
    interlock: Flag | None = None
    remote: Flag | None = None


class CheckedLines(StrictModel):
    """`checked`: framing with a header, the body, a mark and the 8-bit sum of the bytes before the mark."""

    head: str = Field(min_length=1)
    reply_head: str = Field(min_length=1)
    mark: str = Field(default="*", min_length=1, max_length=1)
    counts_head: bool = False


class LineSection(ProfileSection):
    """The framing of the lines of a device with text commands, and its queries, which include `identity`."""

    timeout_s: float = Field(default=0.5, gt=0, le=60)
    gap_s: float = Field(default=0.0, ge=0, le=5)
    line_end: str = Field(default="\r\n", min_length=1)
    prompt: str = ""
    checked: CheckedLines | None = None
    silent: Pattern | None = None
    flush: str | None = None
    refused: Pattern | None = None
    decimals: int = Field(default=4, ge=0, le=9)
    serial: SerialSettings = SerialSettings(baud=9600)
    queries: dict[str, Query]

    rules: ClassVar[Rules[Any]] = (
        lambda s: (
            EntryError("profile.silent_matches_query", "silent", query=name, line=query.send)
            for name, query in s.queries.items()
            if s.silent is not None and re.search(s.silent, query.send)
        ),
        lambda s: (
            s.refused is not None and re.search(s.refused, "") and EntryError("profile.refused_matches_all", "refused")
        ),
        lambda s: (
            s.flush is not None
            and s.flush not in s.queries
            and EntryError("profile.no_such_query", "flush", name=s.flush, remedy=near_miss(s.flush, s.queries))
        ),
    )

    @property
    def first_axis(self) -> str:
        """Name of the first axis in the lines; "" for a device without axes."""
        return ""

    def needed_groups(self, needed: Mapping[str, Sequence[str]], required: Collection[str]) -> Iterator[EntryError]:
        """Yield errors for required queries that are missing, and for answers without the needed groups."""
        for name in required:
            if name not in self.queries:
                yield EntryError("entry.missing", "queries", name)
        for name, groups in needed.items():
            for group in groups if name in self.queries else ():
                if group not in self.queries[name].groups:
                    yield EntryError("profile.group_missing", "queries", name, "answer", group=group)

    def flag_errors(self, flags: "Mapping[str, Flag | None]") -> Iterator[EntryError]:
        """Yield the errors in the sources of flags."""
        seen: dict[tuple[str | None, str, int | str | None], str] = {}
        for name, flag in flags.items():
            key_path = ("flags", name)
            if flag is None:
                continue
            if flag.query is None:
                if name in _VARIABLE_FLAGS:
                    yield EntryError("profile.flag_cannot_be_constant", *key_path)
                continue
            if flag.query not in self.queries:
                yield EntryError(
                    "profile.no_such_query", *key_path, name=flag.query, remedy=near_miss(flag.query, self.queries)
                )
            if flag.group not in self.queries[flag.query].groups:
                yield EntryError("profile.no_such_group", *key_path, query=flag.query, group=flag.group)
            source = (flag.query, flag.group, flag.matches if flag.bit is None else flag.bit)
            if other := seen.get(source):
                yield EntryError("profile.same_flag", *key_path, other=other)
            seen[source] = name


class TextSection(LineSection):
    """`[text]`: the framing of lines, and the lines of commands and queries."""

    joint_names: ClassVar[tuple[str, ...]] = ("outer", "inner")
    axes: list[str]
    rest_rate_dps: float = Field(default=0.002, gt=0, le=10)
    settled_deg: float = Field(default=0.0005, gt=0, le=10)
    settled_polls: int = Field(default=5, ge=2, le=100)
    commands: CommandLines
    flags: Flags

    rules: ClassVar[Rules[Any]] = (
        lambda s: (
            not len(s.axes) == len(set(s.axes) - {""}) == len(s.joint_names)
            and EntryError(f"profile.{'two_axis' if len(s.joint_names) == 2 else 'joint'}_names", "axes", value=s.axes)
        ),
        lambda s: s._query_errors(),
        *LineSection.rules[:2],
        lambda s: s.flag_errors(dict(s.flags)),
        LineSection.rules[2],
    )

    @property
    def first_axis(self) -> str:
        """Name of the first axis in the lines."""
        return self.axes[0]

    def _query_errors(self) -> Iterator[EntryError]:
        needed: dict[str, Sequence[str]] = {"identity": ("model",), "limits": ("low", "high"), "watchdog": ("value",)}
        for name in ("position", "rate"):
            if name in self.queries:
                needed[name] = ("value",) if "{axis}" in self.queries[name].send else self.joint_names
        yield from self.needed_groups(needed, ("identity", "position", "rate"))
        if self.commands.heartbeat and "watchdog" not in self.queries:
            yield EntryError("profile.heartbeat_without_watchdog", "commands", "heartbeat")


class GimbalCommands(CommandLines):
    """`[gimbal.commands]`: the lines of each command, in order."""

    home: list[str] = Field(min_length=1)
    move: list[str] = Field(default_factory=list, max_length=0)
    lock: list[str] = Field(min_length=1)
    stabilise: list[str] = Field(min_length=1)
    turn: list[str] = Field(min_length=1)


class GimbalSection(TextSection):
    """`[gimbal]`: the entries of `[text]`; `axes` contains the names of the joints x, y and z in the lines."""

    joint_names: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    commands: GimbalCommands

    rules: ClassVar[Rules[Any]] = (
        *TextSection.rules,
        lambda s: not s.commands.heartbeat and EntryError("entry.missing", "commands", "heartbeat"),
    )
