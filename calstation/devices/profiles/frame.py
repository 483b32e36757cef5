"""The frame of a profile (`[frame]`): where packets begin and end, what checks them, where numbers stand."""

from collections.abc import Collection
from itertools import combinations, pairwise
from typing import Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from calstation.devices.codecs.frame_checks import CHECK_WIDTHS, CheckFunction, check_function, parametric_crc
from calstation.devices.codecs.numbers import ByteOrder, NumberName, WordOrder, check_orders, number
from calstation.schema import EntryError, StrictModel, entry, suggestion

LARGEST_FRAME = 65_536


def hex_bytes(text: str) -> bytes:
    """Bytes written as hexadecimal text, e.g. "55 AA"; raises ValueError."""
    try:
        return bytes.fromhex(text)
    except ValueError:
        raise ValueError(f"'{text}' is not hexadecimal; write bytes like \"55 AA\"") from None


class FrameField(StrictModel):
    """A number in the frame: value = raw × scale + offset; "spare" bytes are skipped.

    at : byte of the frame, or of its item, where it begins (of a text frame: its column); behind the
        field before it where absent
    item : id of the item that carries it, in hexadecimal; only in frames of items
    word_order : of its 16-bit words, where it is not that of the bytes
    per_sample : of a counter, what it counts up in a sample; a clock's ticks, for instance
    reach : of a channel, the size of its value from which on it is saturated; a whole number's type has ends anyway
    prefix, base : of a text frame, letters that stand before the number, and 16 where it is hexadecimal
    """

    name: str
    type: NumberName
    scale: float = 1.0
    offset: float = 0.0
    at: int | None = Field(default=None, ge=0, lt=LARGEST_FRAME)
    item: str | None = None
    word_order: WordOrder | None = None
    per_sample: float = Field(default=1.0, gt=0)
    reach: float | None = Field(default=None, gt=0)
    prefix: str = ""
    base: Literal[10, 16] = 10

    @field_validator("item")
    @classmethod
    def _item(cls, item: str | None) -> str | None:
        if item is not None:
            hex_bytes(item)
        return item

    @field_validator("scale")
    @classmethod
    def _scale(cls, scale: float) -> float:
        if scale == 0.0:
            raise ValueError("is 0, so every value would be; give the value of 1 in the frame")
        return scale

    @model_validator(mode="after")
    def _orders(self) -> "FrameField":
        check_orders(self.type, self.word_order)
        return self

    @property
    def width(self) -> int:
        """Bytes that it takes."""
        return number(self.type).width


class CrcSection(StrictModel):
    """A frame's check, over everything from byte `start` of the frame up to it.

    kind : a name of `checks`, or "crc" with the parameters below (the Rocksoft model's)
    pad : zero bytes taken into the check behind the last
    byte_order : of the check on the wire, the frame's where absent; in a text frame it stands in hexadecimal
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
            raise ValueError(
                f"check '{kind}' is unknown; it must be one of {', '.join(CHECK_WIDTHS)}, or crc with its parameters"
            )
        return kind

    @model_validator(mode="after")
    def _parameters(self) -> "CrcSection":
        given = self.model_fields_set & {
            "width", "polynomial", "initial", "reflect_in", "reflect_out", "final_xor"
        }  # fmt: skip
        if self.kind != "crc":
            if given:
                raise ValueError(f'{sorted(given)[0]} belongs to kind = "crc"; remove it')
            return self
        if self.width is None or not self.polynomial:
            raise ValueError('kind = "crc" needs width and polynomial; add them')
        for name in ("polynomial", "initial", "final_xor"):
            if getattr(self, name) >> self.width:
                raise ValueError(f"{name} = 0x{getattr(self, name):X} has more than {self.width} bits")
        return self

    @property
    def size(self) -> int:
        """Bytes of the check."""
        return self.width // 8 if self.width else CHECK_WIDTHS[self.kind]

    def function(self) -> CheckFunction:
        """What computes it, padding included."""
        function = check_function(self.kind) if self.kind != "crc" else self._parametric()
        if not self.pad:
            return function
        padding = bytes(self.pad)
        return lambda data: function(data + padding)

    def _parametric(self) -> CheckFunction:
        assert self.width is not None
        return parametric_crc(
            self.width, self.polynomial, self.initial, self.reflect_in, self.reflect_out, self.final_xor
        )


class LengthSection(StrictModel):
    """`length`: the number in the header that tells a frame's size.

    at, type : where it stands; adds : bytes of the frame that it does not count
    extended : type of a longer length that follows where all bits of the first are set; what stands behind
        moves by its bytes
    """

    at: int = Field(ge=0, lt=64)
    type: Literal["u8", "u16"]
    adds: int = Field(ge=0, lt=LARGEST_FRAME)
    extended: Literal["u16"] | None = None


class ItemSection(StrictModel):
    """`items`: fields that each carry their own id and length, from byte `at` up to the check.

    order : which of id and length comes first; counts_header : the length counts both of them as well
    """

    at: int = Field(ge=0, lt=64)
    order: Literal["id length", "length id"]
    id: Literal["u8", "u16"]
    length: Literal["u8", "u16"]
    counts_header: bool

    @property
    def header(self) -> int:
        """Bytes of id and length."""
        return number(self.id).width + number(self.length).width


class IdSection(StrictModel):
    """`id`: the bytes that tell frames of samples from other frames of the same shape."""

    at: int = Field(ge=0, lt=64)
    value: str

    @field_validator("value")
    @classmethod
    def _value(cls, value: str) -> str:
        hex_bytes(value)
        return value


class FrameSection(StrictModel):
    """`[frame]`: sync, fields, check, and what a frame that is more than these has besides.

    sync : first bytes in hexadecimal; of a text frame, its first characters
    tail : constant bytes behind the check
    max_size : bytes above which a length is noise
    separator, mark, tail : of a text frame: between numbers, before the check, and the end of the line
    """

    format: Literal["binary", "text"] = "binary"
    sync: str
    byte_order: ByteOrder = "little"
    fields: list[FrameField]
    crc: CrcSection
    tail: str | None = None
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
                raise ValueError(f"'{sync}' must be the first characters of a line, in ASCII")
        elif not hex_bytes(sync):
            raise ValueError('is empty; write the first bytes of a frame like "55 AA"')
        return sync

    @field_validator("tail")
    @classmethod
    def _tail(cls, tail: str | None) -> str | None:
        if tail is not None:
            hex_bytes(tail)
        return tail

    @property
    def sync_bytes(self) -> bytes:
        """First bytes of every frame."""
        return self.sync.encode("ascii") if self.format == "text" else hex_bytes(self.sync)

    @property
    def tail_bytes(self) -> bytes:
        """Last bytes of every frame, behind the check."""
        if self.tail is None:
            return b"\r\n" if self.format == "text" else b""
        return hex_bytes(self.tail)

    @property
    def body(self) -> int:
        """First byte behind sync, length and id, where fields begin that say nothing else."""
        return max(end for _, end in self._header().values())

    def _header(self) -> dict[str, tuple[int, int]]:
        """First byte of sync, length and id, and the one behind each."""
        found = {"sync": (0, len(self.sync_bytes))}
        if self.length is not None:
            found["length"] = (self.length.at, self.length.at + number(self.length.type).width)
        if self.id is not None:
            found["id"] = (self.id.at, self.id.at + len(hex_bytes(self.id.value)))
        return found

    def least_size(self, names: Collection[str] = ()) -> int:
        """Bytes that a frame with the fields of these names takes at least; with all fields where none are told."""
        wanted = {f.name for f in self.fields if f.name in names or not names}
        behind = self.crc.size + len(self.tail_bytes)
        if (
            self.format == "text"
        ):  # a digit and a separator each, the mark, two digits for a byte of the check
            return len(self.sync_bytes) + 2 * len(self.fields) + 1 + self.crc.size + behind
        if self.items is None:
            ends = [end for f, _, end in self._places() if f.name in wanted or self.length is None]
            return max(ends, default=self.body) + behind
        ends_of: dict[str, int] = {}
        for f, _, end in self._places():
            if f.name in wanted:
                ends_of[f.item or ""] = max(end, ends_of.get(f.item or "", 0))
        return self.items.at + sum(self.items.header + end for end in ends_of.values()) + behind

    def _places(self) -> list[tuple[FrameField, int, int]]:
        """Each field with its first byte, in the frame or in its item, and the one behind its last."""
        ends: dict[str, int] = {}
        found = []
        for f in self.fields:
            key = f.item or ""
            begin = ends.get(key, 0 if key else self.body) if f.at is None else f.at
            ends[key] = begin + f.width
            found.append((f, begin, ends[key]))
        return found

    def field(self, name: str) -> FrameField | None:
        """The field of a name, None where there is none."""
        return next((f for f in self.fields if f.name == name), None)

    @model_validator(mode="after")
    def _consistent(self) -> "FrameSection":
        names = [f.name for f in self.fields]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise EntryError(f"field '{name}' is there twice; remove one", "fields", i)
        if self.format == "text":
            self._check_text()
            return self
        if "byte_order" not in self.model_fields_set:
            raise ValueError("byte_order is missing; add it")
        for i, f in enumerate(self.fields):
            if f.prefix or f.base != 10:
                raise EntryError(
                    f"field '{f.name}': prefix and base belong to a text frame; remove them", "fields", i
                )
        self._check_header()
        if self.items is not None:
            self._check_items(self.items)
        else:
            self._check_plain()
        return self

    def _check_text(self) -> None:
        for name in ("length", "items", "id"):
            if getattr(self, name) is not None:
                raise ValueError(f"{name} does not belong to a text frame; remove it")
        if not self.tail_bytes:
            raise ValueError("tail is empty, but a text frame needs an end of line")
        if self.crc.start > len(self.sync_bytes) + 1:
            raise ValueError(
                f"crc.start = {self.crc.start} lies behind sync, so some of the numbers would not be checked;"
                " correct it"
            )
        for i, f in enumerate(self.fields):
            if f.item is not None or f.word_order is not None:
                raise EntryError(
                    f"field '{f.name}': item and word_order do not belong to a text frame; remove them",
                    *("fields", i),
                )

    def _check_header(self) -> None:
        """Sync, length and id lie apart, and the check begins before the frame ends."""
        for (a, at), (b, other) in combinations(self._header().items(), 2):
            if at[0] < other[1] and other[0] < at[1]:
                raise ValueError(f"{b}.at = {other[0]} overlaps {a}, bytes {at[0]}-{at[1] - 1}; correct it")
        end = self.least_size() - self.crc.size - len(self.tail_bytes)
        if self.crc.start >= end:
            raise ValueError(
                f"crc.start = {self.crc.start} lies behind what it is to check, bytes 0-{end - 1}; correct it"
            )
        if self.length is not None and self.items is None:
            longest = (1 << 8 * number(self.length.extended or self.length.type).width) - 1 + self.length.adds
            if min(longest, self.max_size) < self.least_size():
                raise ValueError(
                    f"length tells no more than {min(longest, self.max_size)} bytes, the fields need"
                    f" {self.least_size()}; correct length.type, length.adds or max_size"
                )

    def _check_items(self, items: ItemSection) -> None:
        if self.length is None:
            raise ValueError("items need a length in the header; add length")
        for i, f in enumerate(self.fields):
            if f.item is None:
                raise EntryError(
                    f"field '{f.name}' must name the item that carries it; add item", "fields", i
                )
            if len(hex_bytes(f.item)) != number(items.id).width:
                raise EntryError(
                    f"field '{f.name}': item '{f.item}' is not as long as an id; correct it", "fields", i
                )
        if items.at < self.body:
            raise ValueError(
                f"items.at = {items.at} lies within sync, length and id, which end at byte {self.body - 1}; correct it"
            )
        ordered = sorted(self._places(), key=lambda place: (place[0].item or "", place[1]))
        for (first, _, end), (second, begin, _) in pairwise(ordered):
            if first.item == second.item and begin < end:
                raise EntryError(
                    f"fields '{first.name}' and '{second.name}' overlap at byte {begin} of item '{first.item}';"
                    " correct at",
                    *("fields", self.fields.index(second)),
                )

    def _check_plain(self) -> None:
        if self.length is not None and self.length.extended and any(f.at is not None for f in self.fields):
            raise ValueError("length.extended moves the fields, so none may have an at; remove it")
        place = self.body
        for i, f in enumerate(self.fields):
            with entry("fields", i):
                if f.item is not None:
                    raise ValueError(f"field '{f.name}' names an item, but the frame has none; add items")
                begin = place if f.at is None else f.at
                if begin < place:
                    raise ValueError(
                        f"field '{f.name}' at byte {begin} overlaps what stands before it, up to byte {place - 1};"
                        " list fields in their order and correct at"
                    )
            place = begin + f.width
        if place + self.crc.size + len(self.tail_bytes) > self.max_size:
            raise ValueError(f"the fields take {place} bytes, more than max_size = {self.max_size}")


def unknown_field(name: str, known: tuple[str, ...]) -> str:
    """What is said of a field that means nothing to the station."""
    return f"field '{name}' is unknown{suggestion(name, known) or '; call unused bytes spare1 ...'}"
