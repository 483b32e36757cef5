"""Lines of a NovAtel RAWIMUSA log."""

from zlib import crc32


def novatel_check(text: str) -> int:
    """Return NovAtel's CRC-32, which differs from zlib's by the missing inversions at the start and the end."""
    return crc32(text.encode(), 0xFFFFFFFF) ^ 0xFFFFFFFF


def novatel_line(seconds: float, week: int = 1815) -> str:
    body = f"RAWIMUSA,{week},{seconds:.3f};{week},{seconds:.9f},00000077,63811,-6290,6253,7,-31,14"
    return f"%{body}*{novatel_check(body):08x}\r\n"
