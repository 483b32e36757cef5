"""Bytes of a device as a person can read them: short, what is no letter written as its number."""

#: Characters shown, where nothing else is asked for.
LENGTH = 40


def quoted(data: bytes, length: int = LENGTH) -> str:
    """The first characters of some bytes; "..." stands for what is left out."""
    text = ""
    for byte in data:
        letter = chr(byte) if 0x20 <= byte < 0x7F and byte != 0x5C else f"\\x{byte:02x}"
        if len(text) + len(letter) > length:
            return f"{text}..."
        text += letter
    return text


def quoted_text(text: str, length: int = LENGTH) -> str:
    """The same of bytes that were taken for text, each byte a letter."""
    return quoted(text.encode("latin-1", "replace"), length)
