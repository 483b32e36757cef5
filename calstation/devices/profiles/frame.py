"""The section `[frame]` of a profile with the fields and checksum of frames, and the range of the channels."""

from collections.abc import Collection
from dataclasses import dataclass, field
from itertools import combinations, pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from calstation.devices.codecs import (
    CHECK_WIDTHS,
    ByteOrder,
    CheckFunction,
    Number,
    NumberName,
    WordOrder,
    check_function,
    number,
    order_error,
    parametric_crc,
)
from calstation.devices.profiles.entries import (
    HexText,
    ProfileSection,
    Rules,
    Scale,
    check,
    each,
    each_item,
    excludes,
    hex_bytes,
    is_set,
    needs,
    one_of,
    only_if,
    only_with,
)
from calstation.messages import Text
from calstation.physics import FloatArray
from calstation.schema import EntryError, StrictModel, near_miss

MAX_FRAME_SIZE = 65_536

CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
#: Status words, which are combined into one word of 48 bits whose lowest 16 bits are `status`.
STATUS_WORDS = ("status", "status2", "status3")
#: Names of fields with a meaning; the names of all others begin with "spare".
FIELDS = ("counter", *CHANNELS, "temperature", *STATUS_WORDS)


class FrameField(ProfileSection):
    """A number in a frame, where value = raw × scale + offset; "spare" bytes are skipped."""

    name: str
    type: NumberName
    scale: Scale = 1.0
    offset: float = 0.0
    at: int | None = Field(default=None, ge=0, lt=MAX_FRAME_SIZE)
    item: HexText | None = None
    word_order: WordOrder | None = None
    per_sample: float = Field(default=1.0, gt=0)
    reach: float | None = Field(default=None, gt=0)
    prefix: str = ""
    base: Literal[10, 16] = 10

    rules: ClassVar[Rules["FrameField"]] = (lambda f: order_error(f.type, f.word_order),)

    @property
    def width(self) -> int:
        """Size of the number in bytes."""
        return number(self.type).width

    @property
    def is_float(self) -> bool:
        """Whether the field is a floating-point number; a floating-point counter contains time."""
        return number(self.type).kind == "f"

    @property
    def counts_samples(self) -> bool:
        """Whether the type suits a counter: unsigned, or floating-point seconds with `per_sample`."""
        return is_set(self, "per_sample") if self.is_float else number(self.type) == Number("u", self.width)

    def fits_word(self, width: int) -> bool:
        """Return whether a status word is an integer of at most `width` bytes; True for any other field."""
        return self.name not in STATUS_WORDS or (number(self.type).is_integer and self.width <= width)

    @property
    def is_spare(self) -> bool:
        """Whether the field has no meaning."""
        return self.name.startswith("spare")


class CrcSection(ProfileSection):
    """The checksum of a frame, computed over all bytes from `start` up to the checksum."""

    kind: Annotated[str, one_of([*CHECK_WIDTHS, "crc"])]
    start: int = Field(ge=0)
    pad: int = Field(default=0, ge=0, le=64)
    byte_order: ByteOrder | None = None
    width: Literal[8, 16, 24, 32] | None = None
    polynomial: int = Field(default=0, ge=0, lt=1 << 32)
    initial: int = Field(default=0, ge=0, lt=1 << 32)
    reflect_in: bool = False
    reflect_out: bool = False
    final_xor: int = Field(default=0, ge=0, lt=1 << 32)

    rules: ClassVar[Rules["CrcSection"]] = (
        *only_if(
            lambda crc: crc.kind != "crc",
            only_with('kind = "crc"', "final_xor", "initial", "polynomial", "reflect_in", "reflect_out", "width"),
        ),
        *only_if(lambda crc: crc.kind == "crc", needs('kind = "crc"', "width", "polynomial")),
        lambda crc: (
            EntryError("profile.too_many_bits", name, value=getattr(crc, name), bits=crc.width)
            for name in ("polynomial", "initial", "final_xor")
            if crc.width and getattr(crc, name) >> crc.width
        ),
    )

    @property
    def size(self) -> int:
        """Size of the checksum in bytes."""
        return self.width // 8 if self.width else CHECK_WIDTHS[self.kind]

    def function(self) -> CheckFunction:
        """Return the function that computes the checksum, including the padding."""
        if self.width is None:
            function = check_function(self.kind)
        else:
            orders = (self.reflect_in, self.reflect_out)
            function = parametric_crc(self.width, self.polynomial, self.initial, *orders, self.final_xor)
        if not self.pad:
            return function
        padding = bytes(self.pad)
        return lambda data: function(data + padding)


class LengthSection(StrictModel):
    """`length`: the number in the header that determines the size of the frame."""

    at: int = Field(ge=0, lt=64)
    type: Literal["u8", "u16"]
    adds: int = Field(ge=0, lt=MAX_FRAME_SIZE)
    extended: Literal["u16"] | None = None


class ItemSection(StrictModel):
    """`items`: items with an id and a length, from byte `at` up to the checksum."""

    at: int = Field(ge=0, lt=64)
    order: Literal["id length", "length id"]
    id: Literal["u8", "u16"]
    length: Literal["u8", "u16"]
    counts_header: bool

    @property
    def header(self) -> int:
        """Size of the id and the length in bytes."""
        return number(self.id).width + number(self.length).width


class IdSection(StrictModel):
    """`id`: the bytes that distinguish sample frames from other frames with the same layout."""

    at: int = Field(ge=0, lt=64)
    value: HexText


class FrameSection(ProfileSection):
    """`[frame]`: sync, fields and checksum of a frame, and the optional parts of its header."""

    format: Literal["binary", "text"] = "binary"
    sync: str
    byte_order: ByteOrder = "little"
    fields: list[FrameField]
    crc: CrcSection
    tail: HexText | None = None
    length: LengthSection | None = None
    items: ItemSection | None = None
    id: IdSection | None = None
    max_size: int = Field(default=2048, ge=2, le=MAX_FRAME_SIZE)
    separator: str = Field(default=",", min_length=1, max_length=1)
    mark: str = Field(default="*", min_length=1, max_length=1)

    @field_validator("sync")
    @classmethod
    def _check_sync(cls, sync: str, info: ValidationInfo) -> str:
        if info.data.get("format") == "text":
            if not sync or not sync.isascii():
                raise EntryError("profile.text_sync", value=sync)
        elif not hex_bytes(sync):
            raise EntryError("profile.no_sync_bytes")
        return sync

    @property
    def sync_bytes(self) -> bytes:
        """First bytes of every frame."""
        return self.sync.encode("ascii") if self.format == "text" else hex_bytes(self.sync)

    @property
    def tail_bytes(self) -> bytes:
        """Last bytes of every frame, after the checksum."""
        if self.tail is None:
            return b"\r\n" if self.format == "text" else b""
        return hex_bytes(self.tail)

    @property
    def body(self) -> int:
        """Index of the first byte after sync, length and id, at which the fields begin."""
        return max(end for _, end in self._header().values())

    @property
    def counter_period(self) -> float:
        """Number of samples after which the counter or the unit's clock wraps around."""
        counter = self.required_field("counter")
        return np.inf if counter.is_float else 2.0 ** (8 * counter.width) / counter.per_sample

    def field(self, name: str) -> FrameField | None:
        """Return the field with a name; None if there is none."""
        return next((f for f in self.fields if f.name == name), None)

    def required_field(self, name: str) -> FrameField:
        """Return the field with a name that every validated sample frame contains."""
        return next(f for f in self.fields if f.name == name)

    def positions(self) -> list[tuple[FrameField, int, int]]:
        """Return each field with its byte range [first, last + 1) in the frame or in its item."""
        ends: dict[str, int] = {}
        positions = []
        for f in self.fields:
            key = f.item or ""
            begin = ends.get(key, 0 if key else self.body) if f.at is None else f.at
            ends[key] = begin + f.width
            positions.append((f, begin, ends[key]))
        return positions

    def min_size(self, names: Collection[str] = ()) -> int:
        """Return the smallest size in bytes of a frame with these fields, by default with all fields."""
        counted = {f.name for f in self.fields if f.name in names or not names}
        trailer = self.crc.size + len(self.tail_bytes)
        if self.format == "text":  # a digit and a separator per field, the mark, two digits per checksum byte
            return len(self.sync_bytes) + 2 * len(self.fields) + 1 + self.crc.size + trailer
        if self.items is None:
            ends = [end for f, _, end in self.positions() if f.name in counted or self.length is None]
            return max(ends, default=self.body) + trailer
        ends_of: dict[str, int] = {}
        for f, _, end in self.positions():
            if f.name in counted:
                ends_of[f.item or ""] = max(end, ends_of.get(f.item or "", 0))
        return self.items.at + sum(self.items.header + end for end in ends_of.values()) + trailer

    @property
    def end(self) -> int:
        """Index of the first byte after the fields of the shortest frame."""
        return self.min_size() - self.crc.size - len(self.tail_bytes)

    @property
    def max_length(self) -> float:
        """Largest frame size in bytes that the length field and `max_size` allow; infinite without a length field."""
        if self.length is None:
            return np.inf
        stated = (1 << 8 * number(self.length.extended or self.length.type).width) - 1
        return min(stated + self.length.adds, self.max_size)

    def _header(self) -> dict[str, tuple[int, int]]:
        """Return the byte ranges [first, last + 1) of sync, length and id."""
        ranges = {"sync": (0, len(self.sync_bytes))}
        if self.length is not None:
            ranges["length"] = (self.length.at, self.length.at + number(self.length.type).width)
        if self.id is not None:
            ranges["id"] = (self.id.at, self.id.at + len(hex_bytes(self.id.value)))
        return ranges

    rules: ClassVar[Rules["FrameSection"]] = (
        each_item(
            "fields", lambda s, i, f: s.field(f.name) is not f and EntryError("profile.field_twice", name=f.name)
        ),
        *only_if(
            lambda s: s.format == "text",
            excludes('format = "text"', "length", "items", "id"),
            lambda s: not s.tail_bytes and EntryError("profile.text_without_end", "tail"),
            lambda s: (
                s.crc.start > len(s.sync_bytes) + 1
                and EntryError("profile.check_after_sync", "crc", "start", value=s.crc.start)
            ),
            each("fields", excludes('format = "text"', "item", "word_order")),
        ),
        *only_if(
            lambda s: s.format == "binary",
            lambda s: "byte_order" not in s.model_fields_set and EntryError("entry.missing", "byte_order"),
            each("fields", only_with('format = "text"', "prefix", "base")),
            lambda s: (
                EntryError("profile.header_overlap", b, "at", other=a, first=at[0], last=at[1] - 1)
                for (a, at), (b, other) in combinations(s._header().items(), 2)
                if at[0] < other[1] and other[0] < at[1]
            ),
            lambda s: (
                s.crc.start >= s.end
                and EntryError("profile.check_after_frame", "crc", "start", value=s.crc.start, last=s.end - 1)
            ),
        ),
        *only_if(
            lambda s: s.items is not None,
            needs("items", "length"),
            each("fields", needs("items", "item")),
            each_item(
                "fields",
                lambda s, i, f: (
                    len(hex_bytes(f.item)) != number(s.items.id).width
                    and EntryError("profile.item_id_size", "item", value=f.item)
                ),
            ),
            lambda s: (
                s.items.at < s.body
                and EntryError("profile.items_in_header", "items", "at", value=s.items.at, last=s.body - 1)
            ),
            lambda s: (
                EntryError("profile.fields_overlap", "fields", s.fields.index(f), "at", other=a.name, byte=begin)
                for (a, _, end), (f, begin, _) in pairwise(sorted(s.positions(), key=lambda at: (at[0].item, at[1])))
                if a.item == f.item and begin < end
            ),
        ),
        *only_if(
            lambda s: s.format == "binary" and s.items is None,
            lambda s: (
                s.max_length < s.min_size()
                and EntryError("profile.length_too_short", "length", longest=s.max_length, needed=s.min_size())
            ),
            *only_if(lambda s: s.length and s.length.extended, each("fields", excludes("length.extended", "at"))),
            each("fields", only_with("items", "item")),
            lambda s: (
                EntryError("profile.field_order", "fields", i, "at", value=begin, last=end - 1)
                for i, ((_, _, end), (_, begin, _)) in enumerate(pairwise([(None, 0, s.body), *s.positions()]))
                if begin < end
            ),
            lambda s: (
                s.min_size() > s.max_size
                and EntryError("profile.fields_too_long", "fields", size=s.end, limit=s.max_size)
            ),
        ),
    )


def _unknown_name(f: FrameField) -> EntryError:
    remedy = near_miss(f.name, FIELDS, Text("profile.call_it_spare"))
    return EntryError("entry.unknown_name", "name", name=f.name, remedy=remedy)


#: Rules for a frame with the fields of a sample.
SAMPLE_RULES: Rules[FrameSection] = (
    each("fields", lambda f: f.name not in FIELDS and not f.is_spare and _unknown_name(f)),
    lambda s: (
        EntryError("profile.no_counter" if name == "counter" else "profile.field_missing", "fields", name=name)
        for name in ("counter", *CHANNELS)
        if s.field(name) is None
    ),
    each(
        "fields",
        *only_if(
            lambda f: f.name not in CHANNELS,
            lambda f: is_set(f, "reach") and EntryError("profile.only_of_channels", "reach"),
        ),
        *only_if(
            lambda f: f.name != "counter",
            lambda f: is_set(f, "per_sample") and EntryError("profile.only_of_counter", "per_sample"),
        ),
        *only_if(
            lambda f: f.name == "counter",
            lambda f: is_set(f, "scale") and EntryError("profile.counter_scaled", "scale"),
            lambda f: is_set(f, "offset") and EntryError("profile.counter_scaled", "offset"),
            lambda f: not f.counts_samples and EntryError("profile.counter_type", "type", value=f.type),
        ),
        *only_if(
            lambda f: f.name in STATUS_WORDS,
            lambda f: is_set(f, "scale") and EntryError("profile.status_scaled", "scale"),
            lambda f: is_set(f, "offset") and EntryError("profile.status_scaled", "offset"),
        ),
    ),
    *only_if(
        lambda s: sum(f.name in STATUS_WORDS for f in s.fields) > 1,
        each("fields", lambda f: not f.fits_word(2) and EntryError("profile.status_word_type", "type", value=f.type)),
    ),
    each("fields", lambda f: not f.fits_word(8) and EntryError("profile.status_type", "type", value=f.type)),
)


def check_samples(frame: FrameSection) -> FrameSection:
    """Return `frame` if it has the fields of a sample. Raises EntryError."""
    return check(frame, SAMPLE_RULES)


#: A frame with the fields of a sample.
SampleFrame = Annotated[FrameSection, AfterValidator(check_samples)]


@dataclass(frozen=True)
class ChannelRange:
    """Resolution and range of the six channels of a stream, in counts, each of shape (6,).

    step : smallest difference between two values, 0 for floats, infinite if unknown
    low, high : values at which the output is saturated
    """

    step: FloatArray = field(default_factory=lambda: np.ones(len(CHANNELS)))
    low: FloatArray = field(default_factory=lambda: np.full(len(CHANNELS), -np.inf))
    high: FloatArray = field(default_factory=lambda: np.full(len(CHANNELS), np.inf))


def channel_range(frame: FrameSection) -> ChannelRange:
    """Return the resolution and range of a frame's channels; integers are saturated at the bounds of their type."""
    steps, ends = [], []
    for name in CHANNELS:
        f = frame.required_field(name)
        kind = number(f.type)
        if kind.kind == "f":
            steps.append(np.inf if frame.format == "text" else 0.0)  # the digits of a text line are unknown
            low, high = -np.inf, np.inf
        else:
            steps.append(kind.step(f.scale))
            low, high = (end + f.offset for end in kind.scaled_bounds(f.scale))
        reach = np.inf if f.reach is None else f.reach
        ends.append((max(low, -reach), min(high, reach)))
    return ChannelRange(np.array(steps), *np.array(ends, np.float64).T)
