"""Exchange of lines of text with a table or chamber, which are plain, end with a prompt or have a checksum."""

import math
import re
import time
from collections.abc import Iterator

from calstation.devices.codecs import check_function, quote_text
from calstation.devices.links.dialogue import QUIET_TIME
from calstation.devices.links.serial_link import Device, SerialLink
from calstation.devices.profiles import CheckedLines, LineSection, SerialSettings
from calstation.errors import DeviceFaultError

_ATTEMPTS = 3
#: Maximum size of a reply in bytes; more bytes without the end of a reply are noise.
_MAX_REPLY_SIZE = 4096


class TextRefusalError(DeviceFaultError):
    """The device refuses a line."""


class UnexpectedReplyError(DeviceFaultError):
    """The reply of the device does not match the profile."""


def text_number(text: str) -> float:
    """Return the number in a reply. Raises DeviceFaultError if the text is not a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DeviceFaultError("table.not_a_number", answer=text)
    return value


class PlainFraming:
    """Framing in which each reply is one line (ACL)."""

    def __init__(self, section: LineSection) -> None:
        self._end = section.line_end

    def request(self, line: str) -> bytes:
        """Return the bytes to send."""
        return (line + self._end).encode("latin-1")

    def reply(self, line: str, received: bytes) -> tuple[str, bytes] | None:
        """Return the reply to `line` in the received bytes and the remaining bytes; None if the reply is incomplete."""
        while b"\n" in received:
            first, _, received = received.partition(b"\n")
            words = self._words(line, first.decode("latin-1").strip())
            if words:
                return words, received
        return None

    def _words(self, line: str, received: str) -> str:
        """Return the text of a received line, or "" if it does not reply to `line`."""
        return received


class PromptedFraming(PlainFraming):
    """Framing in which replies end with a prompt (ATL)."""

    def __init__(self, section: LineSection) -> None:
        super().__init__(section)
        self._prompt = section.prompt.encode("latin-1")

    def reply(self, line: str, received: bytes) -> tuple[str, bytes] | None:
        """Return the reply as in `PlainFraming`, without an echo of the line."""
        text, prompt, rest = received.partition(self._prompt)
        if not prompt:
            return None
        words = [part.strip() for part in text.decode("latin-1").splitlines()]
        return "\n".join(word for word in words if word and word != line), rest


class ChecksummedFraming(PlainFraming):
    """Framing with a header and a checksum, in which the reply repeats the letters of the command ($MN...*SS)."""

    def __init__(self, section: LineSection, lines: CheckedLines) -> None:
        super().__init__(section)
        self._lines, self._sum = lines, check_function("sum8")

    def request(self, line: str) -> bytes:
        """Return the bytes to send."""
        body = self._lines.head + line
        return f"{body}{self._lines.mark}{self._check(body, self._lines.head)}{self._end}".encode("latin-1")

    def _words(self, line: str, received: str) -> str:
        """Return the text of a line if its checksum is correct and its command matches `line`."""
        begin = received.rfind(self._lines.reply_head)
        body, mark, stated = received[begin:].rpartition(self._lines.mark) if begin >= 0 else ("", "", "")
        words = body.removeprefix(self._lines.reply_head)
        valid = bool(mark) and stated.upper() == self._check(body, self._lines.reply_head)
        return words if valid and re.split(r"[,?]", words)[0] == re.split(r"[,?]", line)[0] else ""

    def _check(self, body: str, head: str) -> str:
        counted = body if self._lines.counts_head else body.removeprefix(head)
        return f"{self._sum(counted.encode('latin-1')):02X}"


class TextLink:
    """The link to a table or chamber with text commands. The class is not thread-safe.

    Because a reply rarely identifies its line, a late reply could be mistaken for the reply to the next line. After an
    unanswered line, a query with a distinct reply is therefore sent, and all other replies are discarded. After the
    link was opened again, the device is identified before any command is sent. `received` contains the bytes received
    last.
    """

    def __init__(self, port: str, section: LineSection, serial: SerialSettings, device: Device = "table") -> None:
        self.received = b""
        self._device: Device = device
        self._port, self._section, self._serial = port, section, serial
        if section.checked is not None:
            self._framing: PlainFraming = ChecksummedFraming(section, section.checked)
        else:
            self._framing = PromptedFraming(section) if section.prompt else PlainFraming(section)
        self._silent = re.compile(section.silent) if section.silent else None
        self._refused = re.compile(section.refused) if section.refused else None
        self._questions = {
            query.send.format(axis=section.first_axis): re.compile(query.answer)
            for query in (section.queries["identity"], *section.queries.values())
        }
        self._identity = next(iter(self._questions))
        self._identified_as: str | None = None
        self._replies: dict[str, str] = {}  #: Last reply to each query.
        #: Lines whose replies may still arrive, with the pattern of the reply to a query.
        self._unanswered: dict[str, re.Pattern[str] | None] = {}
        self._last_sent = 0.0
        self._link: SerialLink | None = self._open()
        self._needs_identification = False

    def ask(self, line: str, answer: re.Pattern[str]) -> str:
        """Send a query at most 3 times and return its reply. Raises DeviceFaultError, e.g. TextRefusalError."""
        for _ in range(_ATTEMPTS):
            if self._synchronise() and (reply := self._exchange(line, answer)) is not None:
                if line == self._identity:
                    self._identified_as = reply
                return reply
        raise self._not_answered(line)

    def command(self, line: str, repeat: bool = True) -> None:
        """Send a command, followed by the flush query if it has no reply. Raises the errors of `ask`.

        If `repeat`, the command, e.g. a stop, is sent immediately even if late replies may arrive, and again after a
        lost reply.
        """
        if self._silent is not None and self._silent.search(line):
            if self._is_identified() or self._synchronise():
                self._send(line)
                if self._section.flush:
                    query = self._section.queries[self._section.flush]
                    self.ask(query.send.format(axis=self._section.first_axis), re.compile(query.answer))
                return
            raise self._not_answered(line)
        if repeat and self._unanswered and self._is_identified():
            self._send(line)
        for attempt in range(_ATTEMPTS if repeat else 1):
            # The reply may belong to either of two equal lines, and the other reply may still arrive.
            again = attempt > 0 and self._is_identified()
            if (again or self._synchronise()) and self._exchange(line, None) is not None:
                return
        raise self._not_answered(line)

    def close(self) -> None:
        """Close the link; this never raises an exception."""
        if self._link is not None:
            self._link.close()

    def _open(self) -> SerialLink:
        # pyserial and the station files use different URL schemes for sockets.
        url = self._port.replace("tcp://", "socket://", 1) if self._port.startswith("tcp://") else self._port
        self._needs_identification = True
        return SerialLink(url, self._serial, self._device)

    def _is_identified(self) -> bool:
        """Return whether the link is open, and was opened for the first time or identified since."""
        return self._link is not None and not self._needs_identification

    def _synchronise(self) -> bool:
        """Query the device if late replies may arrive; return whether the next reply will belong to the next line."""
        if self._is_identified() and not self._unanswered:
            return True
        line = next(self._distinct_lines(), self._identity) if self._is_identified() else self._identity
        reply = self._exchange(line, self._questions[line], strict=True)
        if reply is None:
            return False
        if line == self._identity and reply != (self._identified_as or reply):
            self._close_link()
            expected = quote_text(self._identified_as or "")
            raise DeviceFaultError("table.other_table", port=self._port, found=quote_text(reply), expected=expected)
        # the reply may belong to an older query with the same line, and other replies may still arrive
        self._wait_until_quiet(self._section.timeout_s if line in self._unanswered else QUIET_TIME)
        self._unanswered.clear()
        self._needs_identification = False
        return True

    def _distinct_lines(self) -> Iterator[str]:
        """Yield the queries whose replies cannot be confused with any reply that may still arrive.

        There is none if the reply to an unanswered query is unknown: a number may be part of the identity, for example.
        """
        if any(answer is not None and line not in self._replies for line, answer in self._unanswered.items()):
            return
        late = [self._replies[line] for line in self._unanswered if line in self._replies]
        for line, answer in self._questions.items():
            if answer not in self._unanswered.values() and not any(map(answer.search, late)):
                yield line

    def _send(self, line: str) -> SerialLink:
        link = self._link = self._link or self._open()
        wait = self._section.gap_s - (time.monotonic() - self._last_sent)
        if wait > 0.0:
            time.sleep(wait)
        try:
            while stale := link.read(0.0):
                self.received = stale
            link.write(self._framing.request(line))
        except DeviceFaultError:
            self._close_link()
            raise
        finally:
            self._last_sent = time.monotonic()
        return link

    def _exchange(self, line: str, answer: re.Pattern[str] | None, strict: bool = False) -> str | None:
        """Send a line and return its reply, or None if none arrives in time.

        If `strict`, only a reply that matches `answer` is accepted; otherwise any reply is accepted if none matches.
        """
        link = self._send(line)
        deadline = time.monotonic() + self._section.timeout_s
        other: str | None = None
        received = b""
        while (remaining := deadline - time.monotonic()) > 0 and len(received) < _MAX_REPLY_SIZE:
            try:
                data = link.read(remaining)
            except DeviceFaultError:
                self._close_link()
                raise
            received += data
            self.received = data or self.received
            while (parsed := self._framing.reply(line, received)) is not None:
                text, received = parsed
                is_answer = answer is not None and answer.search(text) is not None
                if is_answer:
                    self._replies[line] = text
                if strict:
                    if is_answer:
                        return text
                    continue
                other = text
                if self._refused and self._refused.search(text):
                    raise TextRefusalError("table.line_refused", line=line, answer=quote_text(text))
                if answer is None or is_answer:
                    return text
        if answer is not None or other is None:
            self._unanswered[line] = answer
            if "://" in self._port:  # the system may not report a lost connection
                self._close_link()
            else:
                self._wait_until_quiet()
        return other

    def _wait_until_quiet(self, quiet: float = QUIET_TIME) -> None:
        """Wait until no byte arrives for `quiet` s, but for at most about three reply timeouts."""
        deadline = time.monotonic() + (3.0 if quiet > QUIET_TIME else 1.0) * self._section.timeout_s
        while self._link is not None and time.monotonic() < deadline:
            try:
                if not self._link.read(quiet):
                    return
            except DeviceFaultError:
                self._close_link()

    def _not_answered(self, line: str) -> DeviceFaultError:
        return DeviceFaultError("table.line_unanswered", line=line, port=self._port, seconds=self._section.timeout_s)

    def _close_link(self) -> None:
        if self._link is not None:
            self._link.close()
        self._link = None
