"""The section `[frame]` of a profile: packets, their checksum and fields, and the range of the channels."""

from collections.abc import Collection
from dataclasses import dataclass, field
from itertools import combinations, pairwise
from typing import Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from calstation.devices.codecs import (
    CHECK_WIDTHS,
    ByteOrder,
    CheckFunction,
    NumberName,
    WordOrder,
    check_function,
    check_orders,
    number,
    parametric_crc,
)
from calstation.devices.profiles.entries import HexText, Scale, hex_bytes
from calstation.messages import Text
from calstation.physics import FloatArray
from calstation.schema import EntryError, StrictModel, entry, near_miss

LARGEST_FRAME = 65_536

CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
#: Status words, which are joined into one of 48 bits with `status` as the lowest 16 bits.
STATUS_WORDS = ("status", "status2", "status3")
#: Names of fields with a meaning; all others are "spare...".
FIELDS = ("counter", *CHANNELS, "temperature", *STATUS_WORDS)


class FrameField(StrictModel):
    """A number in the frame: value = raw × scale + offset; "spare" bytes are skipped.

    at : first byte in the frame or item, or column in a text frame; directly after the previous field if absent
    item : id of the item that contains the field, in hexadecimal; only in frames of items
    word_order : order of its 16-bit words, if it differs from the byte order
    per_sample : increment of a counter per sample, e.g. the ticks of a clock, or seconds for a float
    reach : absolute value at and above which a channel is saturated, in addition to the bounds of its type
    prefix, base : in a text frame, the letters before the number, and 16 for hexadecimal numbers
    """

    name: str
    type: NumberName
    scale: Scale = 1.0
    offset: float = 0.0
    at: int | None = Field(default=None, ge=0, lt=LARGEST_FRAME)
    item: HexText | None = None
    word_order: WordOrder | None = None
    per_sample: float = Field(default=1.0, gt=0)
    reach: float | None = Field(default=None, gt=0)
    prefix: str = ""
    base: Literal[10, 16] = 10

    @model_validator(mode="after")
    def _orders(self) -> "FrameField":
        check_orders(self.type, self.word_order)
        return self

    @property
    def width(self) -> int:
        """Size in bytes."""
        return number(self.type).width

    @property
    def is_float(self) -> bool:
        """Whether the field is a floating-point number; a floating-point counter contains time."""
        return number(self.type).kind == "f"

    @property
    def is_spare(self) -> bool:
        return self.name.startswith("spare")


class CrcSection(StrictModel):
    """The checksum of a frame, computed over all bytes from `start` up to the checksum.

    kind : name of a checksum in `frame_checks`, or "crc" with the parameters below (Rocksoft model)
    pad : zero bytes appended to the checked bytes
    byte_order : order of the checksum itself, by default the frame's; in a text frame the checksum is hexadecimal
    """

    kind: str
    start: int = Field(ge=0)
    pad: int = Field(default=0, ge=0, le=64)
    byte_order: ByteOrder | None = None
    width: Literal[8, 16, 24, 32] | None = None
    polynomial: int = Field(default=0, ge=0, lt=1 << 32)
    initial: int = Field(default=0, ge=0, lt=1 << 32)
    reflect_in: bool = False
    reflect_out: bool = False
    final_xor: int = Field(default=0, ge=0, lt=1 << 32)

    @field_validator("kind")
    @classmethod
    def _known(cls, kind: str) -> str:
        if kind != "crc" and kind not in CHECK_WIDTHS:
            raise EntryError("profile.unknown_check", value=kind, names=[*CHECK_WIDTHS, "crc"])
        return kind

    @model_validator(mode="after")
    def _parameters(self) -> "CrcSection":
        if self.kind != "crc":
            fixed = {"kind", "start", "pad", "byte_order"}
            for name in sorted(self.model_fields_set - fixed):
                raise EntryError("profile.belongs_to", name, owner='kind = "crc"')
            return self
        if not self.width or not self.polynomial:
            raise EntryError("profile.needed_by", "polynomial" if self.width else "width", owner='kind = "crc"')
        for name in ("polynomial", "initial", "final_xor"):
            if getattr(self, name) >> self.width:
                raise EntryError("profile.too_many_bits", name, value=getattr(self, name), bits=self.width)
        return self

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
    """`length`: the number in the header that gives the frame's size.

    at, type : its position and type; adds : number of bytes of the frame that it does not include
    extended : type of a longer length that follows if all bits of the first are set; it shifts the data after it
    """

    at: int = Field(ge=0, lt=64)
    type: Literal["u8", "u16"]
    adds: int = Field(ge=0, lt=LARGEST_FRAME)
    extended: Literal["u16"] | None = None


class ItemSection(StrictModel):
    """`items`: items with their own id and length, from byte `at` up to the checksum.

    order : order of id and length; counts_header : whether the length includes both of them
    """

    at: int = Field(ge=0, lt=64)
    order: Literal["id length", "length id"]
    id: Literal["u8", "u16"]
    length: Literal["u8", "u16"]
    counts_header: bool

    @property
    def header(self) -> int:
        return number(self.id).width + number(self.length).width


class IdSection(StrictModel):
    """`id`: the bytes that distinguish sample frames from other frames with the same layout."""

    at: int = Field(ge=0, lt=64)
    value: HexText


class FrameSection(StrictModel):
    """`[frame]`: sync, fields and checksum of a frame, and the optional parts of its header.

    sync : first bytes in hexadecimal; in a text frame, its first characters
    tail : constant bytes after the checksum
    max_size : size in bytes above which a length is treated as noise
    separator, mark, tail : in a text frame, the characters between numbers, before the checksum, and at the line end
    """

    format: Literal["binary", "text"] = "binary"
    sync: str
    byte_order: ByteOrder = "little"
    fields: list[FrameField]
    crc: CrcSection
    tail: HexText | None = None
    length: LengthSection | None = None
    items: ItemSection | None = None
    id: IdSection | None = None
    max_size: int = Field(default=2048, ge=2, le=LARGEST_FRAME)
    separator: str = Field(default=",", min_length=1, max_length=1)
    mark: str = Field(default="*", min_length=1, max_length=1)

    @field_validator("sync")
    @classmethod
    def _sync(cls, sync: str, info: ValidationInfo) -> str:
        if info.data.get("format") == "text":
            if not sync or not sync.isascii():
                raise EntryError("profile.text_sync", value=sync)
        elif not hex_bytes(sync):
            raise EntryError("profile.no_sync_bytes")
        return sync

    @property
    def sync_bytes(self) -> bytes:
        return self.sync.encode("ascii") if self.format == "text" else hex_bytes(self.sync)

    @property
    def tail_bytes(self) -> bytes:
        """Last bytes of every frame, after the checksum."""
        if self.tail is None:
            return b"\r\n" if self.format == "text" else b""
        return hex_bytes(self.tail)

    @property
    def body(self) -> int:
        """Index of the first byte after sync, length and id, where the fields begin."""
        return max(end for _, end in self._header().values())

    @property
    def counter_period(self) -> float:
        """Number of samples after which the counter, or the unit's clock, wraps."""
        counter = self.named("counter")
        return np.inf if counter.is_float else 2.0 ** (8 * counter.width) / counter.per_sample

    def field(self, name: str) -> FrameField | None:
        return next((f for f in self.fields if f.name == name), None)

    def named(self, name: str) -> FrameField:
        """Return the field with a name, which every validated sample frame contains."""
        return next(f for f in self.fields if f.name == name)

    def positions(self) -> list[tuple[FrameField, int, int]]:
        """Return each field with its byte range [first, last + 1), in the frame or in its item."""
        ends: dict[str, int] = {}
        positions = []
        for f in self.fields:
            key = f.item or ""
            begin = ends.get(key, 0 if key else self.body) if f.at is None else f.at
            ends[key] = begin + f.width
            positions.append((f, begin, ends[key]))
        return positions

    def min_size(self, names: Collection[str] = ()) -> int:
        """Return the smallest size in bytes of a frame with the fields of these names, or with all fields."""
        counted = {f.name for f in self.fields if f.name in names or not names}
        trailer = self.crc.size + len(self.tail_bytes)
        if self.format == "text":  # digit and separator per field, mark, two digits per checksum byte
            return len(self.sync_bytes) + 2 * len(self.fields) + 1 + self.crc.size + trailer
        if self.items is None:
            ends = [end for f, _, end in self.positions() if f.name in counted or self.length is None]
            return max(ends, default=self.body) + trailer
        ends_of: dict[str, int] = {}
        for f, _, end in self.positions():
            if f.name in counted:
                ends_of[f.item or ""] = max(end, ends_of.get(f.item or "", 0))
        return self.items.at + sum(self.items.header + end for end in ends_of.values()) + trailer

    def _header(self) -> dict[str, tuple[int, int]]:
        """Return the byte ranges [first, last + 1) of sync, length and id."""
        ranges = {"sync": (0, len(self.sync_bytes))}
        if self.length is not None:
            ranges["length"] = (self.length.at, self.length.at + number(self.length.type).width)
        if self.id is not None:
            ranges["id"] = (self.id.at, self.id.at + len(hex_bytes(self.id.value)))
        return ranges

    @model_validator(mode="after")
    def _consistent(self) -> "FrameSection":
        names = [f.name for f in self.fields]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise EntryError("profile.field_twice", "fields", i, name=name)
        if self.format == "text":
            self._check_text()
            return self
        if "byte_order" not in self.model_fields_set:
            raise EntryError("entry.missing", "byte_order")
        self._refuse_in_fields("profile.belongs_to", "prefix", "base", owner='format = "text"')
        self._check_header()
        if self.items is not None:
            self._check_items(self.items)
        else:
            self._check_plain()
        return self

    def _check_text(self) -> None:
        for name in ("length", "items", "id"):
            if getattr(self, name) is not None:
                raise EntryError("profile.not_with", name, other='format = "text"')
        if not self.tail_bytes:
            raise EntryError("profile.text_without_end", "tail")
        if self.crc.start > len(self.sync_bytes) + 1:
            raise EntryError("profile.check_after_sync", "crc", "start", value=self.crc.start)
        self._refuse_in_fields("profile.not_with", "item", "word_order", other='format = "text"')

    def _refuse_in_fields(self, code: str, *names: str, **values: str) -> None:
        """Raise EntryError with a code for the first field with one of these entries."""
        for i, f in enumerate(self.fields):
            for name in names:
                if getattr(f, name) != FrameField.model_fields[name].default:
                    raise EntryError(code, "fields", i, name, **values)

    def _check_header(self) -> None:
        """Check that sync, length and id do not overlap, and that the checksum is within the frame."""
        for (a, at), (b, other) in combinations(self._header().items(), 2):
            if at[0] < other[1] and other[0] < at[1]:
                raise EntryError("profile.header_overlap", b, "at", other=a, first=at[0], last=at[1] - 1)
        end = self.min_size() - self.crc.size - len(self.tail_bytes)
        if self.crc.start >= end:
            raise EntryError("profile.check_after_frame", "crc", "start", value=self.crc.start, last=end - 1)
        if self.length is not None and self.items is None:
            longest = (1 << 8 * number(self.length.extended or self.length.type).width) - 1 + self.length.adds
            longest = min(longest, self.max_size)
            if longest < self.min_size():
                raise EntryError("profile.length_too_short", "length", longest=longest, needed=self.min_size())

    def _check_items(self, items: ItemSection) -> None:
        if self.length is None:
            raise EntryError("profile.needed_by", "length", owner="items")
        for i, f in enumerate(self.fields):
            if f.item is None:
                raise EntryError("profile.needed_by", "fields", i, "item", owner="items")
            if len(hex_bytes(f.item)) != number(items.id).width:
                raise EntryError("profile.item_id_size", "fields", i, "item", value=f.item)
        if items.at < self.body:
            raise EntryError("profile.items_in_header", "items", "at", value=items.at, last=self.body - 1)
        ordered = sorted(self.positions(), key=lambda position: (position[0].item or "", position[1]))
        for (first, _, end), (second, begin, _) in pairwise(ordered):
            if first.item == second.item and begin < end:
                at = ("fields", self.fields.index(second), "at")
                raise EntryError("profile.fields_overlap", *at, other=first.name, byte=begin)

    def _check_plain(self) -> None:
        if self.length is not None and self.length.extended:
            self._refuse_in_fields("profile.not_with", "at", other="length.extended")
        self._refuse_in_fields("profile.belongs_to", "item", owner="items")
        end = self.body
        for i, (_, begin, stop) in enumerate(self.positions()):
            if begin < end:
                raise EntryError("profile.field_order", "fields", i, "at", value=begin, last=end - 1)
            end = stop
        if end + self.crc.size + len(self.tail_bytes) > self.max_size:
            raise EntryError("profile.fields_too_long", "fields", size=end, limit=self.max_size)


def check_samples(frame: FrameSection) -> None:
    """Check that a frame has the fields of a sample; raises EntryError."""
    for i, f in enumerate(frame.fields):
        if f.name not in FIELDS and not f.is_spare:
            remedy = near_miss(f.name, FIELDS, Text("profile.call_it_spare"))
            raise EntryError("entry.unknown_name", "fields", i, "name", name=f.name, remedy=remedy)
    for name in ("counter", *CHANNELS):
        if frame.field(name) is None:
            raise EntryError("profile.field_missing", "fields", name=name)
    words = sum(f.name in STATUS_WORDS for f in frame.fields)
    for i, f in enumerate(frame.fields):
        with entry("fields", i):
            _check_field(f, words)


def _check_field(f: FrameField, words: int) -> None:
    """Check that the keys of a field suit its meaning; `words` is the number of status words."""
    is_counter, is_word = f.name == "counter", f.name in STATUS_WORDS
    if f.reach is not None and f.name not in CHANNELS:
        raise EntryError("profile.only_of_channels", "reach")
    if f.per_sample != 1.0 and not is_counter:
        raise EntryError("profile.only_of_counter", "per_sample")
    if (is_counter or is_word) and (f.scale != 1.0 or f.offset != 0.0):
        code = "profile.counter_scaled" if is_counter else "profile.status_scaled"
        raise EntryError(code, "scale" if f.scale != 1.0 else "offset")
    kind = number(f.type)
    if is_counter and (kind.kind == "i" or kind.fraction or (kind.kind == "f" and f.per_sample == 1.0)):
        raise EntryError("profile.counter_type", "type", value=f.type)
    if is_word and words > 1 and (not kind.whole or f.width > 2):
        raise EntryError("profile.status_word_type", "type", value=f.type)
    if is_word and not kind.whole:
        raise EntryError("profile.status_type", "type", value=f.type)


@dataclass(frozen=True)
class Span:
    """Resolution and range of the six channels of a stream, in counts, each of shape (6,).

    step : smallest difference between two values: 0 for floats, infinite if unknown
    low, high : values at which the output is saturated
    """

    step: FloatArray = field(default_factory=lambda: np.ones(len(CHANNELS)))
    low: FloatArray = field(default_factory=lambda: np.full(len(CHANNELS), -np.inf))
    high: FloatArray = field(default_factory=lambda: np.full(len(CHANNELS), np.inf))


def span(frame: FrameSection) -> Span:
    """Return the resolution and range of a frame's channels; an integer at a bound of its type is saturated."""
    steps, ends = [], []
    for name in CHANNELS:
        f = frame.named(name)
        kind = number(f.type)
        if kind.kind == "f":
            steps.append(np.inf if frame.format == "text" else 0.0)  # the digits of a text line are unknown
            low, high = -np.inf, np.inf
        else:
            steps.append(kind.step(f.scale))
            low, high = (end + f.offset for end in kind.scaled_bounds(f.scale))
        reach = np.inf if f.reach is None else f.reach
        ends.append((max(low, -reach), min(high, reach)))
    return Span(np.array(steps), *np.array(ends, np.float64).T)
