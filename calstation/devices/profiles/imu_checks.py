"""What the parts of an IMU profile must not say against each other; every complaint names its entry and the mend."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

from calstation.devices.codecs.numbers import number
from calstation.devices.imu.sample_count import wrap
from calstation.devices.links.serial_link import SerialSettings
from calstation.devices.profiles.channels import CHANNELS
from calstation.devices.profiles.frame import FrameField, FrameSection
from calstation.devices.profiles.registers import RegisterEntry
from calstation.schema import EntryError, entry

if TYPE_CHECKING:
    from calstation.devices.profiles.imu import ModbusUnitSection, StatusSection

#: Ticks of a VectorNav's clock in a second.
_NANOSECONDS = 1e9

#: Shortest time in which a counter may wrap, s: what is lost in a whole wrap is missed by the station's clock, by
#: which
#: samples come a few hundredths of a second sooner or later.
SHORTEST_WRAP = 0.1

_LARGEST_ADDRESS = 0xFFFF


def check_samples(frame: FrameSection, status_words: Sequence[str]) -> None:
    """Are a frame's fields those of a sample? Raises ValueError naming the field.

    Parameters
    ----------
    status_words : names of the status words, the lowest first
    """
    for name in ("counter", *CHANNELS):
        if frame.field(name) is None:
            raise ValueError(f"field '{name}' is missing; add it in its place")
    words = [f for f in frame.fields if f.name in status_words]
    for i, f in enumerate(frame.fields):
        with entry("fields", i):
            _check_field(f, f in words, len(words))


def _check_field(f: FrameField, is_word: bool, words: int) -> None:
    """What a field is, and what belongs to it; `words` of the status are there in all."""
    if f.reach is not None and f.name not in CHANNELS:
        raise ValueError(f"field '{f.name}' is no channel and has no reach; remove it")
    if f.per_sample != 1.0 and f.name != "counter":
        raise ValueError(f"field '{f.name}' is no counter and has no per_sample; remove it")
    if (is_word or f.name == "counter") and (f.scale != 1.0 or f.offset != 0.0):
        instead = "say per_sample instead" if f.name == "counter" else "remove them"
        raise ValueError(f"field '{f.name}' has no scale and no offset; {instead}")
    kind = number(f.type)
    if f.name == "counter" and (kind.kind != "u" or kind.fraction):
        raise ValueError(f"field 'counter' has type '{f.type}'; it must be u8 to u64")
    if is_word and (not kind.whole or (words > 1 and f.width > 2)):
        allowed = "u8 or u16" if words > 1 else "a whole number"
        raise ValueError(f"field '{f.name}' has type '{f.type}'; it must be {allowed}")


def check_status(status: "StatusSection", frame: FrameSection, status_words: Sequence[str]) -> None:
    """Does the frame hold the bits of the status that are looked at? Raises ValueError naming the mask."""
    words = [(i, frame.field(name)) for i, name in enumerate(status_words)]
    there = sum(((1 << 8 * f.width) - 1) << 16 * i for i, f in words if f is not None)
    masks = {"ready": status.ready, "saturated": status.saturated, "failed": status.failed}
    for name, mask in masks.items():
        if mask & ~there:
            raise ValueError(
                f"status.{name} = 0x{mask:04X} looks at bits that no field of the frame holds; add the field"
                f" '{status_words[0]}' in its place, or correct the mask"
            )
    for name in ("saturated", "failed"):
        if masks["ready"] & masks[name]:
            raise ValueError(
                f"status.ready and status.{name} look at the same bit, so a unit that is ready would be {name};"
                " correct one"
            )


def check_baud(settings: SerialSettings, frame: FrameSection, rate: float) -> None:
    """Can the line carry the stream? Raises ValueError.

    Parameters
    ----------
    rate : samples per second
    """
    parity = 0 if settings.parity == "N" else 1
    bits = 1 + settings.data_bits + parity + settings.stop_bits
    size = frame.least_size(("counter", *CHANNELS))
    needed = bits * size * rate
    if needed > settings.baud:
        raise ValueError(
            f"link.baud = {settings.baud} is too slow for stream.sample_rate_hz = {rate:g} with frames of"
            f" {size} bytes, which take {needed:.0f}; correct one of them"
        )


def check_nanoseconds(frame: FrameSection, rate: float) -> None:
    """Does a VectorNav's clock count what its rate says? Raises ValueError."""
    counter = frame.field("counter")
    if counter is None or counter.per_sample == 1.0:
        return
    expected = _NANOSECONDS / rate
    if abs(counter.per_sample - expected) > 1e-3 * expected:
        raise ValueError(
            f"field 'counter': per_sample = {counter.per_sample:g} does not fit stream.sample_rate_hz = {rate:g}, at"
            f" which the unit's clock counts {expected:g} ns; correct one"
        )


def check_wrap(frame: FrameSection, rate: float) -> None:
    """Does the counter count long enough to show what was lost? Raises ValueError."""
    seconds = wrap(frame) / rate
    if seconds < SHORTEST_WRAP:
        counter = frame.field("counter")
        assert counter is not None
        raise ValueError(
            f"field 'counter': type {counter.type} begins again every {seconds:.3g} s at stream.sample_rate_hz ="
            f" {rate:g}, so nobody would miss what is lost in that time; take a wider number of the frame that counts,"
            " or lower the rate"
        )


def check_sync(frame: FrameSection, reply_sync: bytes) -> None:
    """Can frames be told from replies? Raises ValueError naming the sync."""
    sync = frame.sync_bytes
    if sync.startswith(reply_sync) or reply_sync.startswith(sync):
        raise EntryError(
            "begins as commands.reply_sync does, so samples could not be told from replies; correct one",
            "sync",
        )


def check_modbus_map(section: "ModbusUnitSection", entries: Sequence[RegisterEntry]) -> None:
    """Do the unit's own registers and its calibration lie apart? Raises ValueError naming both.

    What switches, commits, resets or chooses the page answers on every page, so calibration may lie on none of them.
    """
    own = dict(_own_registers(section))
    for name, (begin, end) in own.items():
        if end - 1 > _LARGEST_ADDRESS:
            raise ValueError(f"modbus.{name}: {_named(begin, end)} runs past {_LARGEST_ADDRESS}; correct it")
    for (a, at), (b, other) in combinations(own.items(), 2):
        shared = {a, b} <= set(_orders(section))  # told apart by what is written
        if not shared and at[0] < other[1] and other[0] < at[1]:
            raise ValueError(
                f"modbus.{a} ({_named(*at)}) and modbus.{b} ({_named(*other)}) overlap; correct an address"
            )
    for a, b in combinations(_orders(section), 2):
        if own[a] == own[b] and set(_orders(section)[a]) & set(_orders(section)[b]):
            raise ValueError(f"modbus.{a} and modbus.{b} write the same to register {own[a][0]}; correct one")
    for command in ("commit", "reset"):
        order = getattr(section, command)
        if order.done == order.value:
            raise ValueError(
                f"modbus.{command}: done = {order.done} is what is written, so it would be done at once; correct it"
            )
    for told in entries:
        with entry("registers", told.row):
            _check_place(told, own)


def _check_place(told: RegisterEntry, own: Mapping[str, tuple[int, int]]) -> None:
    needed = number(told.type).width // 2
    if told.span != needed:
        raise ValueError(
            f"{told}: span = {told.span} does not fit type {told.type}, which takes {needed} registers of 16 bits;"
            " remove span"
        )
    for name, (begin, end) in own.items():
        if told.address < end and begin < told.end:
            raise ValueError(f"{told} and modbus.{name} ({_named(begin, end)}) overlap; correct an address")


def _own_registers(section: "ModbusUnitSection") -> Iterator[tuple[str, tuple[int, int]]]:
    """First address and the one behind the last, of everything that is no calibration."""
    for name in ("model", "serial", "firmware"):
        text = getattr(section, name)
        if text is not None:
            yield name, (text.address, text.address + text.words)
    for name in ("commit", "reset", "stream"):
        word = getattr(section, name)
        if word is not None:
            yield name, (word.address, word.address + 1)
    if section.page is not None:
        yield "page", (section.page, section.page + 1)


def _orders(section: "ModbusUnitSection") -> Mapping[str, tuple[int, ...]]:
    """Values that are written to registers in which the value tells what is meant."""
    stream = section.stream
    switch = () if stream is None else tuple(v for v in (stream.on, stream.off) if v is not None)
    found = {"commit": (section.commit.value,), "reset": (section.reset.value,), "stream": switch}
    return {name: values for name, values in found.items() if values}


def _named(begin: int, end: int) -> str:
    return f"register {begin}" if end - begin == 1 else f"registers {begin}-{end - 1}"
