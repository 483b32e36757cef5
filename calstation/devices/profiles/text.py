"""The lines of a table that is commanded in text (`[text]`): what to send, what the answers mean."""

import re
from collections.abc import Mapping, Sequence
from itertools import combinations
from string import Formatter
from typing import Literal

from pydantic import Field, field_validator, model_validator

from calstation.devices.links.serial_link import SerialSettings
from calstation.schema import EntryError, StrictModel, entry, suggestion

#: What a command's line may name in braces, in degrees, °/s and °/s²; also `outer_angle`, `inner_rate` and so on.
COMMAND_VALUES = ("axis", "angle", "rate", "acceleration")
#: Values that each command has to tell; the first it must.
_VALUES = {"move": ("angle", "rate", "acceleration"), "rate": ("rate", "acceleration")}
_MAY_BE_ALIKE = ({"disable", "stop"}, {"disable", "reset"}, {"stop", "reset"})
_NEVER_ALWAYS = ("fault", "moving", "settled")
_FLAGS = ("enabled", "homed", "moving", "settled", "fault", "interlock", "remote")


class CommandLines(StrictModel):
    """`[text.commands]`: the lines of each command, in order; lines that name {axis} go to outer, then inner.

    rate : left out where the table is never to turn endlessly; heartbeat : where it has a watchdog to feed
    """

    enable: list[str] = Field(min_length=1)
    disable: list[str] = Field(min_length=1)
    home: list[str] = Field(default_factory=list)
    move: list[str] = Field(min_length=1)
    rate: list[str] = Field(default_factory=list)
    stop: list[str] = Field(min_length=1)
    reset: list[str] = Field(min_length=1)
    heartbeat: list[str] = Field(default_factory=list)

    @model_validator(mode="after")
    def _can_be_sent(self) -> "CommandLines":
        for name in type(self).model_fields:
            values, lines = _VALUES.get(name, ()), getattr(self, name)
            told: set[str] = set()
            with entry(name):
                for line in lines:
                    told |= _check_line(repr(line), line, values)
                if values and lines:
                    _check_told(values[0], told)
        self._check_distinct()
        return self

    def _check_distinct(self) -> None:
        lines = {name: getattr(self, name) for name in type(self).model_fields if getattr(self, name)}
        for a, b in combinations(lines, 2):
            if lines[a] == lines[b] and {a, b} not in _MAY_BE_ALIKE:
                raise EntryError(f"{a} and {b} send the same lines; correct one", b)


def _check_told(value: str, told: set[str]) -> None:
    """Where to, or how fast, is told of both axes."""
    for joint in ("outer", "inner"):
        if value not in told and f"{joint}_{value}" not in told:
            missing = f"{joint}_{value}" if any(place.endswith(f"_{value}") for place in told) else value
            raise ValueError(
                f"no line tells {{{missing}}}, so the table would go by what it was told before; add it"
            )


def _check_line(called: str, line: str, values: Sequence[str]) -> set[str]:
    """What a line names in braces. Raises ValueError where it cannot be filled in and sent.

    Parameters
    ----------
    called : how messages call it; values : what its command has to tell
    """
    if not line.isascii() or not line.isprintable():
        raise ValueError(f"{called} must be one line of ASCII; remove what is not")
    own = ("axis", *values)
    known = (*own, *(f"{joint}_{name}" for joint in ("outer", "inner") for name in values))
    try:
        parts = list(Formatter().parse(line))
    except ValueError:
        raise ValueError(f"{called} has a brace alone; write {{axis}}, or {{{{ for the character") from None
    told = set()
    for _, place, form, conversion in parts:
        if place is None:
            continue
        if form or conversion or place not in known:
            wrong = place + (f"!{conversion}" if conversion else "") + (f":{form}" if form else "")
            raise ValueError(
                f"{called}: '{{{wrong}}}' is unknown here{suggestion(place, known) or '; it may name '}"
                f"{'' if suggestion(place, known) else ', '.join(known)}"
            )
        told.add(place)
    for place in sorted(told & set(values)):
        if "axis" not in told:
            raise ValueError(
                f"{called} tells {{{place}}} without {{axis}}, so it would be the outer axis's alone; write"
                f" {{outer_{place}}} and {{inner_{place}}}, or add {{axis}}"
            )
    return told


class Query(StrictModel):
    """A question: the line to send, once for each axis where it names {axis}, and what its answer looks like.

    answer : a regular expression, searched in the reply; its named groups are the values
    """

    send: str = Field(min_length=1)
    answer: str

    @field_validator("send")
    @classmethod
    def _line(cls, send: str) -> str:
        _check_line(repr(send), send, ())
        return send

    @field_validator("answer")
    @classmethod
    def _pattern(cls, answer: str) -> str:
        try:
            pattern = re.compile(answer)
        except re.error as exc:
            raise ValueError(f"'{answer}' is no regular expression ({exc})") from None
        if not pattern.groupindex:
            raise ValueError(f"'{answer}' has no named group; write one like (?P<value>[-+0-9.eE]+)")
        return answer


class Flag(StrictModel):
    """What a flag of the status is taken from: a bit or the words of a query's group, or it is always the same.

    base : of the number that has the bit
    """

    query: str | None = None
    group: str = "value"
    bit: int | None = Field(default=None, ge=0, le=63)
    base: Literal[10, 16] = 10
    matches: str | None = None
    always: bool | None = None

    @model_validator(mode="after")
    def _one_way(self) -> "Flag":
        if sum(way is not None for way in (self.bit, self.matches, self.always)) != 1:
            raise ValueError("a flag needs one of bit, matches and always")
        if (self.query is None) != (self.always is not None):
            raise ValueError("a flag needs the query that tells it; only with always it has none")
        return self


class CheckedLines(StrictModel):
    """`checked`: commands and replies are HEAD body MARK check, the check the 8-bit sum of what stands before MARK.

    counts_head : the sum takes the head along
    """

    head: str = Field(min_length=1)
    reply_head: str = Field(min_length=1)
    mark: str = Field(default="*", min_length=1, max_length=1)
    counts_head: bool = False


class TextSection(StrictModel):
    """`[text]`: how lines are framed, and which there are.

    axes : names of the outer and the inner axis in the lines
    timeout_s : host time for an answer; gap_s : host time between two lines
    line_end : of what is sent; prompt : what ends a reply (protocol "atl")
    silent : a regular expression for lines that are not answered; flush : the query asked behind such a line, whose
        answer brings what the table still had to say
    refused : a regular expression for replies that refuse a command
    decimals : of numbers in commands
    rest_rate_dps : below which an axis is at rest, where the table does not say that it moves
    settled_deg, settled_polls : where the table does not say that it has settled: at rest, and no further apart
        than this over so many polls
    """

    axes: list[str]
    timeout_s: float = Field(default=0.5, gt=0, le=60)
    gap_s: float = Field(default=0.0, ge=0, le=5)
    line_end: str = Field(default="\r\n", min_length=1)
    prompt: str = ""
    checked: CheckedLines | None = None
    silent: str | None = None
    flush: str | None = None
    refused: str | None = None
    decimals: int = Field(default=4, ge=0, le=9)
    rest_rate_dps: float = Field(default=0.002, gt=0)
    settled_deg: float = Field(default=0.0005, gt=0)
    settled_polls: int = Field(default=5, ge=2, le=100)
    serial: SerialSettings = SerialSettings(baud=9600)
    commands: CommandLines
    queries: dict[str, Query]
    flags: dict[str, Flag]

    @field_validator("axes")
    @classmethod
    def _two(cls, axes: list[str]) -> list[str]:
        if len(axes) != 2 or axes[0] == axes[1] or not all(axes):
            raise ValueError(
                f'= {axes} must be two different names, of outer and inner axis, like ["1", "2"]; correct it'
            )
        return axes

    @field_validator("silent", "refused")
    @classmethod
    def _pattern(cls, pattern: str | None) -> str | None:
        try:
            re.compile(pattern or "")
        except re.error as exc:
            raise ValueError(f"'{pattern}' is no regular expression ({exc})") from None
        return pattern

    @model_validator(mode="after")
    def _whole(self) -> "TextSection":
        for name in ("identity", "position", "rate"):
            if name not in self.queries:
                raise ValueError(f"queries.{name} is missing; add it")
        if "model" not in self._groups("identity"):
            raise ValueError("queries.identity: the answer needs a group model; add it")
        for name in ("position", "rate"):
            self._needs_joints(name)
        for end in ("low", "high") if "limits" in self.queries else ():
            if end not in self._groups("limits"):
                raise ValueError(f"queries.limits: the answer needs a group {end}; add it")
        if "watchdog" in self.queries and "value" not in self._groups("watchdog"):
            raise ValueError("queries.watchdog: the answer needs a group value, in seconds; add it")
        if self.commands.heartbeat and "watchdog" not in self.queries:
            raise ValueError(
                "commands.heartbeat is never sent where no query tells the watchdog's time, by which it is fed; add"
                " queries.watchdog, or remove it"
            )
        self._check_patterns()
        self._check_flags()
        if self.flush is not None and self.flush not in self.queries:
            raise EntryError(
                f"there is no query '{self.flush}'{suggestion(self.flush, tuple(self.queries))}",
                "flush",
            )
        for name in ("enabled", "homed", "fault"):
            if name not in self.flags:
                raise ValueError(f"flags.{name} is missing; add it")
        return self

    def _groups(self, name: str) -> Mapping[str, int]:
        """Named groups of a query's answer."""
        return re.compile(self.queries[name].answer).groupindex

    def _check_patterns(self) -> None:
        """Questions are answered, and not every answer refuses."""
        for name, query in self.queries.items():
            if self.silent is not None and re.search(self.silent, query.send):
                raise ValueError(
                    f"silent matches queries.{name} '{query.send}', which would never be answered; narrow the pattern"
                )
        if self.refused is not None and re.search(self.refused, ""):
            raise ValueError("refused matches every reply; narrow the pattern, or remove it")

    def _check_flags(self) -> None:
        seen: dict[tuple[str | None, str, int | str | None], str] = {}
        for name, flag in self.flags.items():
            if name not in _FLAGS:
                raise ValueError(f"flags.{name} is unknown{suggestion(name, _FLAGS) or '; remove it'}")
            if flag.query is None:
                if name in _NEVER_ALWAYS:
                    raise ValueError(f"flags.{name} cannot be always the same; say which query tells it")
                continue
            query = self.queries.get(flag.query)
            if query is None:
                raise ValueError(
                    f"flags.{name}: there is no query '{flag.query}'{suggestion(flag.query, tuple(self.queries))}"
                )
            if flag.group not in self._groups(flag.query):
                raise ValueError(
                    f"flags.{name}: query '{flag.query}' has no group '{flag.group}'; correct it"
                )
            place = (flag.query, flag.group, flag.matches if flag.bit is None else flag.bit)
            if other := seen.get(place):
                raise ValueError(f"flags.{name} and flags.{other} are told by the same; correct one")
            seen[place] = name

    def _needs_joints(self, name: str) -> None:
        query = self.queries[name]
        groups = self._groups(name)
        needed = ("value",) if "{axis}" in query.send else ("outer", "inner")
        for group in needed:
            if group not in groups:
                raise ValueError(f"queries.{name}: the answer needs a group {group}; add it")
