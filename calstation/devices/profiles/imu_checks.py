"""Rules between the sections of an IMU profile; each broken one raises EntryError."""

from collections.abc import Mapping, Sequence
from itertools import combinations

from calstation.devices.codecs import number
from calstation.devices.profiles.entries import LAST_ADDRESS
from calstation.devices.profiles.frame import CHANNELS, STATUS_WORDS, FrameSection
from calstation.devices.profiles.imu_sections import CorrectedSection, ModbusUnitSection, StatusSection
from calstation.devices.profiles.registers import RegisterEntry
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.schema import EntryError, entry

#: Ticks of a VectorNav's clock per second.
_NANOSECONDS = 1e9

#: Shortest period of the counter, s: the loss of a whole period is detected by the host's clock, against which samples
#: arrive a few hundredths of a second early or late.
SHORTEST_WRAP = 0.1


def check_status(status: StatusSection, frame: FrameSection, name: str) -> None:
    """Check that the frame of a name holds the bits of the status masks, and that no bit has two meanings."""
    words = [(i, frame.field(word)) for i, word in enumerate(STATUS_WORDS)]
    present = sum(((1 << 8 * f.width) - 1) << 16 * i for i, f in words if f is not None)
    masks = {"ready": status.ready, "saturated": status.saturated, "failed": status.failed}
    for key, mask in masks.items():
        if mask & ~present:
            raise EntryError("profile.mask_outside_frame", "status", key, value=mask, frame=name)
    for key in ("saturated", "failed"):
        if masks["ready"] & masks[key]:
            raise EntryError("profile.mask_of_ready", "status", key)


def check_baud(settings: SerialSettings, frame: FrameSection, rate: float, name: str = "frame") -> None:
    """Check that the serial line can carry a stream of `rate` samples per second; `name` is the frame's."""
    size = frame.min_size(("counter", *CHANNELS))
    needed = settings.bits_per_byte * size * rate
    if needed > settings.baud:
        values = {"frame": name, "size": size, "rate": rate, "needed": needed}
        raise EntryError("profile.baud_too_low", "link", "baud", baud=settings.baud, **values)


def check_nanoseconds(frame: FrameSection, rate: float) -> None:
    """Check that a VectorNav's clock counts the nanoseconds of its sample rate."""
    counter = frame.named("counter")
    expected = _NANOSECONDS / rate
    if counter.per_sample != 1.0 and abs(counter.per_sample - expected) > 1e-3 * expected:
        place = ("fields", frame.fields.index(counter), "per_sample")
        raise EntryError("profile.clock_rate", *place, value=counter.per_sample, rate=rate, expected=expected)


def check_wrap(frame: FrameSection, rate: float) -> None:
    """Check that the counter's period is long enough to detect lost samples."""
    seconds = frame.counter_period / rate
    if seconds < SHORTEST_WRAP:
        counter = frame.named("counter")
        place = ("fields", frame.fields.index(counter), "type")
        raise EntryError("profile.counter_too_short", *place, type=counter.type, seconds=seconds, rate=rate)


def check_sync(frame: FrameSection, reply_sync: bytes) -> None:
    """Check that frames can be distinguished from replies."""
    sync = frame.sync_bytes
    if sync.startswith(reply_sync) or reply_sync.startswith(sync):
        raise EntryError("profile.sync_of_replies", "sync")


def check_corrected(section: CorrectedSection, protocol: str, order: str, raw: tuple[int, ...] | None) -> None:
    """Check that `[corrected]` fits the protocol of its profile and the order of stream and registers.

    raw : values that switch the raw stream on and off; None if the link has no such switch
    """
    if order == "after_registers":
        raise EntryError("profile.not_with", "corrected", other='stream.order = "after_registers"')
    if protocol == "stream":
        raise EntryError("profile.not_with", "corrected", other='protocol = "stream"')
    needed, other = ("start", "stream") if protocol == "vectornav" else ("stream", "start")
    if not _given(section, needed):
        raise EntryError("profile.needed_by", "corrected", needed, owner=f'protocol = "{protocol}"')
    if _given(section, other):
        raise EntryError("profile.not_with", "corrected", other, other=f'protocol = "{protocol}"')
    if section.stream is None:
        return
    if raw is None:
        raise EntryError("profile.needed_by", "modbus", "stream", owner="corrected.stream")
    if section.stream in raw:
        raise EntryError("profile.stream_value_of_raw", "corrected", "stream", value=section.stream)
    if protocol == "framed" and section.stream > 0xFF:
        raise EntryError("entry.out_of_range", "corrected", "stream", value=section.stream, low=2, high=255)


def _given(section: CorrectedSection, name: str) -> bool:
    return getattr(section, name) not in (None, [])


def check_modbus_map(section: ModbusUnitSection, entries: Sequence[RegisterEntry]) -> None:
    """Check that the unit's own registers and its calibration do not overlap.

    Commands and the page register answer on every page, so the calibration may overlap them on none.
    """
    own, written = section.ranges, section.written
    for name, (begin, end) in own.items():
        if end - 1 > LAST_ADDRESS:
            raise EntryError("profile.past_last_address", "modbus", name, address=begin, last=end - 1)
    for (a, at), (b, other) in combinations(own.items(), 2):
        distinguished = a in written and b in written  # by the value
        if not distinguished and at[0] < other[1] and other[0] < at[1]:
            values = {"mine": _span(*other), "other": f"modbus.{a}", "at": _span(*at)}
            raise EntryError("profile.registers_overlap", "modbus", b, **values)
    for a, b in combinations(written, 2):
        if own[a] == own[b] and set(written[a]) & set(written[b]):
            raise EntryError("profile.same_write", "modbus", b, other=f"modbus.{a}")
    for command in ("commit", "reset"):
        order = getattr(section, command)
        if order.done == order.value:
            raise EntryError("profile.done_at_once", "modbus", command, "done", value=order.done)
    for register in entries:
        with entry("registers", register.row):
            _check_span(register, own)


def _check_span(register: RegisterEntry, own: Mapping[str, tuple[int, int]]) -> None:
    needed = number(register.type).width // 2
    if register.span != needed:
        raise EntryError("profile.span", "span", value=register.span, type=register.type, needed=needed)
    for name, (begin, end) in own.items():
        if register.address < end and begin < register.end:
            values = {"mine": register.label, "other": f"modbus.{name}", "at": _span(begin, end)}
            raise EntryError("profile.registers_overlap", "address", **values)


def _span(begin: int, end: int) -> str:
    return f"{begin}" if end - begin == 1 else f"{begin}-{end - 1}"
