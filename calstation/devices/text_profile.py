"""The lines of a table that is commanded in text (`[text]`): what to send, what the answers mean."""

import re
from typing import Literal

from pydantic import Field, field_validator, model_validator

from calstation.configuration import StrictModel, suggestion
from calstation.devices.link import SerialSettings

COMMAND_VALUES = ("axis", "angle", "rate", "acceleration")
"""What a command's line may name in braces, in degrees, °/s and °/s²; also `outer_angle`, `inner_rate` and so on."""
_PLACES = (
    *COMMAND_VALUES,
    *(f"{joint}_{name}" for joint in ("outer", "inner") for name in COMMAND_VALUES[1:]),
)
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
    def _places_known(self) -> "CommandLines":
        for name in type(self).model_fields:
            for line in getattr(self, name):
                for place in re.findall(r"\{([^}]*)\}", line):
                    if place not in _PLACES:
                        raise ValueError(
                            f"{name}: '{{{place}}}' in '{line}' is unknown{suggestion(place, _PLACES)}"
                        )
        return self


class Query(StrictModel):
    """A question: the line to send, once for each axis where it names {axis}, and what its answer looks like.

    answer : a regular expression, searched in the reply; its named groups are the values
    """

    send: str
    answer: str

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

    axes: list[str] = Field(min_length=2, max_length=2)
    timeout_s: float = Field(default=0.5, gt=0, le=60)
    gap_s: float = Field(default=0.0, ge=0, le=5)
    line_end: str = "\r\n"
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
        if "model" not in re.compile(self.queries["identity"].answer).groupindex:
            raise ValueError("queries.identity: the answer needs a group model; add it")
        for name in ("position", "rate"):
            self._needs_joints(name)
        if self.flush is not None and self.flush not in self.queries:
            raise ValueError(
                f"flush: there is no query '{self.flush}'{suggestion(self.flush, tuple(self.queries))}"
            )
        for name, flag in self.flags.items():
            if name not in _FLAGS:
                raise ValueError(f"flags.{name} is unknown{suggestion(name, _FLAGS) or '; remove it'}")
            if flag.query is None:
                continue
            query = self.queries.get(flag.query)
            if query is None:
                raise ValueError(
                    f"flags.{name}: there is no query '{flag.query}'{suggestion(flag.query, tuple(self.queries))}"
                )
            if flag.group not in re.compile(query.answer).groupindex:
                raise ValueError(
                    f"flags.{name}: query '{flag.query}' has no group '{flag.group}'; correct it"
                )
        for name in ("enabled", "homed", "fault"):
            if name not in self.flags:
                raise ValueError(f"flags.{name} is missing; add it")
        return self

    def _needs_joints(self, name: str) -> None:
        query = self.queries[name]
        groups = re.compile(query.answer).groupindex
        needed = ("value",) if "{axis}" in query.send else ("outer", "inner")
        for group in needed:
            if group not in groups:
                raise ValueError(f"queries.{name}: the answer needs a group {group}; add it")
