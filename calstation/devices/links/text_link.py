"""Text lines to a table and their replies, with a prompt, plain or checksummed; each exchange is bounded in time."""

import re
import time

from calstation.devices.codecs import check_function, quoted_text
from calstation.devices.links.dialogue import QUIET
from calstation.devices.links.serial_link import SerialLink
from calstation.devices.profiles import CheckedLines, SerialSettings, TextSection
from calstation.errors import DeviceFaultError

_ATTEMPTS = 3
#: Largest size of a reply in bytes; more bytes without the end of a reply are noise.
_MAX_REPLY_SIZE = 4096


class TextRefusalError(DeviceFaultError):
    """The table refuses a line."""


class UnlikeAnswerError(DeviceFaultError):
    """The table's reply does not have the form specified in the profile."""


class Plain:
    """Framing of lines and replies in which each reply is one line (ACL)."""

    def __init__(self, section: TextSection) -> None:
        self._end = section.line_end

    def request(self, line: str) -> bytes:
        """Return the bytes to send."""
        return (line + self._end).encode("latin-1")

    def reply(self, line: str, received: bytes) -> tuple[str, bytes] | None:
        """Return the reply to `line` in the received bytes and the rest of them; None until the reply is complete."""
        while b"\n" in received:
            first, _, received = received.partition(b"\n")
            words = self._words(line, first.decode("latin-1").strip())
            if words:
                return words, received
        return None

    def _words(self, line: str, received: str) -> str:
        """Return the text of a received line, or "" if it does not reply to `line`."""
        return received


class Prompted(Plain):
    """Framing in which replies end with a prompt (ATL)."""

    def __init__(self, section: TextSection) -> None:
        super().__init__(section)
        self._prompt = section.prompt.encode("latin-1")

    def reply(self, line: str, received: bytes) -> tuple[str, bytes] | None:
        """Return the reply as in `Plain`, without an echo of the line."""
        text, prompt, rest = received.partition(self._prompt)
        if not prompt:
            return None
        words = [part.strip() for part in text.decode("latin-1").splitlines()]
        return "\n".join(word for word in words if word and word != line), rest


class Checked(Plain):
    """Framing with a head and a checksum; the reply repeats the letters of the command ($MN...*SS)."""

    def __init__(self, section: TextSection, lines: CheckedLines) -> None:
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
    """The link to a table with text commands; not thread-safe.

    A reply rarely identifies its line, and a late one looks like the reply to the next line. After an unanswered line,
    a query with a distinct reply is therefore sent, and no other reply is accepted before it. After the link has been
    reopened, the table is identified before any command is sent. `received` are the last bytes received, valid or not.
    """

    def __init__(self, port: str, section: TextSection, serial: SerialSettings) -> None:
        self.received = b""
        self._port, self._section, self._serial = port, section, serial
        if section.checked is not None:
            self._framing: Plain = Checked(section, section.checked)
        else:
            self._framing = Prompted(section) if section.prompt else Plain(section)
        self._silent = re.compile(section.silent) if section.silent else None
        self._refused = re.compile(section.refused) if section.refused else None
        self._questions = {
            query.send.format(axis=section.axes[0]): re.compile(query.answer)
            for query in (section.queries["identity"], *section.queries.values())
        }
        self._identity = next(iter(self._questions))
        self._identified_as: str | None = None
        self._unanswered: list[str] = []
        self._last_sent = 0.0
        self._link: SerialLink | None = self._open()
        self._new = False

    def ask(self, line: str, answer: re.Pattern[str]) -> str:
        """Send a query up to 3 times and return its reply; raises TextRefusalError, or DeviceFaultError without one."""
        for _ in range(_ATTEMPTS):
            if self._synchronised() and (reply := self._exchange(line, answer)) is not None:
                if line == self._identity:
                    self._identified_as = reply
                return reply
        raise self._not_answered(line)

    def command(self, line: str, repeat: bool = True) -> None:
        """Send a command; raises like `ask`. A command without a reply is followed by the flush query.

        repeat : the command, e.g. a stop, may be sent twice; it is sent immediately even if late replies may arrive,
            and again if its reply is lost
        """
        if self._silent is not None and self._silent.search(line):
            if self._known() or self._synchronised():
                self._send(line)
                if self._section.flush:
                    query = self._section.queries[self._section.flush]
                    self.ask(query.send.format(axis=self._section.axes[0]), re.compile(query.answer))
                return
            raise self._not_answered(line)
        if repeat and self._unanswered and self._known():
            self._send(line)
        for attempt in range(_ATTEMPTS if repeat else 1):
            # The reply may belong to either of two equal lines; the reply to the other one may still arrive.
            again = attempt > 0 and self._known()
            if (again or self._synchronised()) and self._exchange(line, None) is not None:
                return
        raise self._not_answered(line)

    def close(self) -> None:
        """Close the link; never raises."""
        if self._link is not None:
            self._link.close()

    def _open(self) -> SerialLink:
        # The URL scheme for sockets differs between pyserial and the station files.
        url = self._port.replace("tcp://", "socket://", 1) if self._port.startswith("tcp://") else self._port
        self._new = True
        return SerialLink(url, self._serial, "table")

    def _known(self) -> bool:
        """Return whether the table has been identified since the link was opened."""
        return self._link is not None and not self._new

    def _synchronised(self) -> bool:
        """Return whether the next reply will belong to the next line; query the table if this is uncertain."""
        if self._known() and not self._unanswered:
            return True
        others = [line for line in self._questions if line not in self._unanswered]
        line = others[0] if others and self._known() else self._identity
        reply = self._exchange(line, self._questions[line], only=True)
        if reply is None:
            return False
        if line == self._identity and reply != (self._identified_as or reply):
            self._drop()
            expected = quoted_text(self._identified_as or "")
            raise DeviceFaultError("table.other_table", port=self._port, found=quoted_text(reply), expected=expected)
        self._wait_until_quiet()
        self._unanswered.clear()
        self._new = False
        return True

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
            self._drop()
            raise
        finally:
            self._last_sent = time.monotonic()
        return link

    def _exchange(self, line: str, answer: re.Pattern[str] | None, only: bool = False) -> str | None:
        """Send a line and return its reply, or None if none arrives in time.

        only : accept only replies that match `answer`; otherwise another reply is accepted if no matching one arrives
        """
        link = self._send(line)
        deadline = time.monotonic() + self._section.timeout_s
        other: str | None = None
        received = b""
        while (remaining := deadline - time.monotonic()) > 0 and len(received) < _MAX_REPLY_SIZE:
            try:
                data = link.read(remaining)
            except DeviceFaultError:
                self._drop()
                raise
            received += data
            self.received = data or self.received
            while (taken := self._framing.reply(line, received)) is not None:
                text, received = taken
                if only:
                    if answer is not None and answer.search(text):
                        return text
                    continue
                other = text
                if self._refused and self._refused.search(text):
                    raise TextRefusalError("table.line_refused", line=line, answer=quoted_text(text))
                if answer is None or answer.search(text):
                    return text
        if answer is not None or other is None:
            self._unanswered.append(line)
            if "://" in self._port:  # the connection may be lost without notice
                self._drop()
            else:
                self._wait_until_quiet()
        return other

    def _wait_until_quiet(self) -> None:
        """Wait until the line is quiet, for at most the reply timeout."""
        deadline = time.monotonic() + self._section.timeout_s
        while self._link is not None and time.monotonic() < deadline:
            try:
                if not self._link.read(QUIET):
                    return
            except DeviceFaultError:
                self._drop()

    def _not_answered(self, line: str) -> DeviceFaultError:
        return DeviceFaultError("table.line_unanswered", line=line, port=self._port, seconds=self._section.timeout_s)

    def _drop(self) -> None:
        if self._link is not None:
            self._link.close()
        self._link = None
