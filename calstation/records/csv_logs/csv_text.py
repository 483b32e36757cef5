"""Text of CSV files in chunks of whole lines, regardless of encoding and line ends."""

import codecs
import gzip
import io
import zlib
from collections.abc import Iterator
from pathlib import Path

from calstation.errors import InputError
from calstation.messages import os_reason

_CHUNK = 1 << 17
#: Length of a line, characters, above which it is refused if it extends beyond a chunk.
_MAX_LINE = 1 << 16
#: Byte-order marks and the encodings they stand for.
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def text_chunks(path: Path) -> Iterator[str]:
    """Yield the text of a file in chunks of whole lines, separated by line feeds, without the final line end.

    The text is UTF-8, or UTF-16 with or without a byte-order mark; lines end with LF, CR LF or CR. Raises InputError.
    """
    remainder, lines = "", 0
    try:
        with _open(path) as stream:
            encoding = _encoding(stream.read(1024))
            stream.seek(0)
            text = io.TextIOWrapper(stream, encoding)  # translates all line ends
            while data := text.read(_CHUNK):
                data = remainder + data
                end = data.rfind("\n") + 1
                remainder = data[end:]
                lines += data.count("\n")
                if end:
                    yield data[: end - 1]
                if len(remainder) > _MAX_LINE:
                    raise InputError("csv.line_too_long", file=path, line=lines + 1, limit=_MAX_LINE)
        if remainder.strip():
            yield remainder
    except FileNotFoundError as exc:
        raise InputError("log.not_found", file=path) from exc
    except (EOFError, zlib.error, gzip.BadGzipFile) as exc:
        raise InputError("csv.damaged_gzip", file=path) from exc
    except UnicodeError as exc:
        raise InputError("csv.not_utf8", file=path) from exc
    except OSError as exc:
        raise InputError("log.unreadable", file=path, reason=os_reason(exc)) from exc


def csv_rows(path: Path) -> int:
    """Estimate the number of samples in a CSV from its size and its first lines; the result is at least 1."""
    try:
        with _open(path) as stream:
            head = stream.read(_CHUNK)
        size = path.stat().st_size
        if path.suffix == ".gz":
            with path.open("rb") as stream:  # RFC 1952, 2.3.1: the last four bytes are the size modulo 2^32
                stream.seek(-4, io.SEEK_END)
                size = int.from_bytes(stream.read(4), "little")
    except (OSError, EOFError, zlib.error):
        return 1  # the error is reported when the file is read
    lines = head.count(b"\n") or head.count(b"\r")
    return max(1, round(size * lines / max(len(head), 1)) - 1)


def _open(path: Path) -> gzip.GzipFile | io.BufferedReader:
    return gzip.open(path) if path.suffix == ".gz" else path.open("rb")


def _encoding(head: bytes) -> str:
    """Return the encoding of a text from its first bytes; without a byte-order mark, alternate zeros mean UTF-16."""
    for mark, name in _MARKS:
        if head.startswith(mark):
            return name
    half = len(head) // 2
    if half > 1 and head[1::2].count(0) > 0.9 * half:
        return "utf-16-le"
    return "utf-16-be" if half > 1 and head[::2].count(0) > 0.9 * half else "utf-8"
