"""Why an IMU's lines of text are no samples: the part of [frame] that is wrong, told of one line that came."""

from calstation.devices.codecs.quoting import quoted
from calstation.devices.imu.text_frames import TextFrame
from calstation.devices.profiles.channels import CHANNELS
from calstation.devices.profiles.frame import FrameSection
from calstation.messages.finding import Finding, Value

#: Share of printable bytes from which what came is text.
_MOSTLY_TEXT = 0.9
_PRINTABLE = frozenset(b"\t" + bytes(range(0x20, 0x7F)))
#: Characters of a line that are shown.
_SHOWN = 120


def wrong_line(frame: FrameSection, heard: bytes) -> Finding | None:
    """What is wrong with the lines in these bytes; None where they are no lines, or are samples.

    frame : of text
    """
    tail = frame.tail_bytes
    lines = [line for line in heard.split(tail)[1:-1] if line]
    printable = sum(byte in _PRINTABLE for line in lines for byte in line)
    if not lines or printable < _MOSTLY_TEXT * sum(map(len, lines)):
        return None
    own = [line for line in lines if line.startswith(frame.sync_bytes)]
    if not own:
        return Finding("line_sync", "wrong", {"sync": frame.sync, "line": _shown(lines[-1])})
    kind = TextFrame(frame)
    for line in own:
        packet = line + tail
        found = _check(frame, kind, packet) or _numbers(frame, kind, packet)
        if found is None:
            return None
    return found


def _check(frame: FrameSection, kind: TextFrame, packet: bytes) -> Finding | None:
    if kind.sound(packet):
        return None
    line = packet[: -len(frame.tail_bytes)]
    body, mark, told = line.rpartition(frame.mark.encode())
    if not mark:
        return Finding("line_mark", "wrong", {"mark": frame.mark, "line": _shown(line)})
    right = frame.crc.function()(body[frame.crc.start :])
    values: dict[str, Value] = {
        "line": _shown(line),
        "told": quoted(told),
        "kind": frame.crc.kind,
        "start": frame.crc.start,
        "right": f"{right:0{2 * frame.crc.size}X}",
    }
    return Finding("line_check", "wrong", values)


def _numbers(frame: FrameSection, kind: TextFrame, packet: bytes) -> Finding | None:
    """The first field of a sample that the columns of a sound line do not hold."""
    line = packet[: -len(frame.tail_bytes)]
    values: dict[str, Value] = {"line": _shown(line)}
    if not kind.sampled(packet):
        return Finding(
            "line_separator", "wrong", {**values, "sync": frame.sync, "separator": frame.separator}
        )
    present = kind.columns([packet]).present
    row = line.rpartition(frame.mark.encode())[0][len(frame.sync_bytes) + 1 :]
    texts = row.decode("ascii", "replace").split(frame.separator)
    for name in ("counter", *CHANNELS):
        if frame.field(name) is None or bool(present[name][0]):
            continue
        column = kind.places[name]
        values |= {"field": name, "column": column}
        if column >= len(texts):
            return Finding("line_short", "wrong", {**values, "count": len(texts)})
        return Finding(
            "line_column", "wrong", {**values, "text": quoted(texts[column].encode("ascii", "replace"))}
        )
    return None


def _shown(line: bytes) -> str:
    return quoted(line, _SHOWN)
