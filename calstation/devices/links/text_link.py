"""Lines of text to a table and back: prompts, plain lines or checked lines, each exchange bounded in time."""

import re
import time
from typing import Protocol

from calstation.devices.codecs.frame_checks import check_function
from calstation.devices.codecs.packets import quoted_text
from calstation.devices.links.serial_link import SerialLink
from calstation.devices.links.unanswered import QUIET
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.devices.profiles.text import CheckedLines, TextSection
from calstation.errors import DeviceFaultError

_ATTEMPTS = 3
#: Bytes of a reply; more without its end is noise.
_LONGEST = 4096


class TextRefusalError(DeviceFaultError):
    """The table understands and refuses a line."""


class UnlikeAnswerError(DeviceFaultError):
    """The table answers otherwise than the profile says."""


class Framing(Protocol):
    """How a line goes out and how its reply is recognised."""

    def request(self, line: str) -> bytes:
        """The bytes to send."""

    def reply(self, line: str, heard: bytes) -> tuple[str, bytes] | None:
        """The reply to `line` in what was heard and what stands behind it; None until it is whole."""


class Prompted:
    """Replies end with a prompt (ATL)."""

    def __init__(self, section: TextSection) -> None:
        self._end, self._prompt = section.line_end, section.prompt.encode("latin-1")

    def request(self, line: str) -> bytes:
        """See `Framing`."""
        return (line + self._end).encode("latin-1")

    def reply(self, line: str, heard: bytes) -> tuple[str, bytes] | None:
        """See `Framing`; an echo of the line is left out."""
        said, prompt, rest = heard.partition(self._prompt)
        if not prompt:
            return None
        words = [part.strip() for part in said.decode("latin-1").splitlines()]
        return "\n".join(word for word in words if word and word != line), rest


class Plain:
    """Each reply is a line (ACL)."""

    def __init__(self, section: TextSection) -> None:
        self._end = section.line_end

    def request(self, line: str) -> bytes:
        """See `Framing`."""
        return (line + self._end).encode("latin-1")

    def reply(self, line: str, heard: bytes) -> tuple[str, bytes] | None:
        """See `Framing`."""
        while b"\n" in heard:
            first, _, heard = heard.partition(b"\n")
            if word := first.decode("latin-1").strip():
                return word, heard
        return None


class Checked:
    """Each line has a head, its reply the command's letters and a sum ($MN...*SS)."""

    def __init__(self, section: TextSection, lines: CheckedLines) -> None:
        self._end, self._lines = section.line_end, lines
        self._sum = check_function("sum8")

    def request(self, line: str) -> bytes:
        """See `Framing`."""
        body = self._lines.head + line
        return f"{body}{self._lines.mark}{self._check(body, self._lines.head):02X}{self._end}".encode(
            "latin-1"
        )

    def reply(self, line: str, heard: bytes) -> tuple[str, bytes] | None:
        """See `Framing`; lines with a wrong sum or to another command are left out."""
        command = re.split(r"[,?]", line)[0]
        while b"\n" in heard:
            first, _, heard = heard.partition(b"\n")
            said = first.decode("latin-1").strip()
            at = said.rfind(self._lines.reply_head)
            body, mark, told = said[at:].rpartition(self._lines.mark) if at >= 0 else ("", "", "")
            sound = bool(mark) and told.upper() == f"{self._check(body, self._lines.reply_head):02X}"
            words = body.removeprefix(self._lines.reply_head)
            if sound and re.split(r"[,?]", words)[0] == command:
                return words, heard
        return None

    def _check(self, body: str, head: str) -> int:
        counted = body if self._lines.counts_head else body.removeprefix(head)
        return self._sum(counted.encode("latin-1"))


class TextLink:
    """The line of a table that is commanded in text; not for use by two threads at once.

    A reply seldom says what it replies to, and one that comes late looks like the next line's. So after a line that
    was not answered a question is asked that is answered otherwise, and nothing is believed before its answer. A link
    that was opened anew is asked who answers there now, before the table is told anything.

    Parameters
    ----------
    port : as in a station file; `tcp://host:port` for a socket
    section : the profile's
    serial : settings of a serial port

    Attributes
    ----------
    heard : the bytes that came last, whether they make sense or not
    """

    def __init__(self, port: str, section: TextSection, serial: SerialSettings) -> None:
        self.heard = b""
        self._port, self._section, self._serial = port, section, serial
        if section.checked is not None:
            self._framing: Framing = Checked(section, section.checked)
        else:
            self._framing = Prompted(section) if section.prompt else Plain(section)
        self._silent = re.compile(section.silent) if section.silent else None
        self._refused = re.compile(section.refused) if section.refused else None
        self._questions = {
            query.send.format(axis=section.axes[0]): re.compile(query.answer)
            for query in (section.queries["identity"], *section.queries.values())
        }
        self._identity = next(iter(self._questions))
        self._told: str | None = None
        self._unanswered: list[str] = []
        self._last_sent = 0.0
        self._link: SerialLink | None = self._open()
        self._new = False

    def ask(self, line: str, answer: re.Pattern[str]) -> str:
        """Send a line that asks and wait for its reply; a lost one is asked for again.

        Parameters
        ----------
        answer : what the reply looks like; one that looks otherwise is passed over while there is time

        Raises
        ------
        TextRefusalError
            where the table refuses it.
        DeviceFaultError
            where no reply comes, the port is lost, or another table answers than before.
        """
        for _ in range(_ATTEMPTS):
            if self._settled() and (reply := self._exchange(line, answer)) is not None:
                if line == self._identity:
                    self._told = reply
                return reply
        raise self._not_answered(line)

    def command(self, line: str, repeat: bool = True) -> None:
        """Send a line that commands; raises as `ask`. A line that is not answered is followed by the flush.

        repeat : it may be said twice. So it is said at once, however much is still to come, as it may be a stop; and
            again where its reply was lost
        """
        if self._silent is not None and self._silent.search(line):
            if self._known() or self._settled():
                self._send(line)
                if self._section.flush:
                    query = self._section.queries[self._section.flush]
                    self.ask(query.send.format(axis=self._section.axes[0]), re.compile(query.answer))
                return
            raise self._not_answered(line)
        if repeat and self._unanswered and self._known():
            self._send(line)
        for attempt in range(_ATTEMPTS if repeat else 1):
            # Whichever of two is answered that say the same, it is done; but the other's reply may still come.
            again = attempt > 0 and self._known()
            if (again or self._settled()) and self._exchange(line, None) is not None:
                return
        raise self._not_answered(line)

    def close(self) -> None:
        """Hang up; never raises."""
        if self._link is not None:
            self._link.close()

    def _open(self) -> SerialLink:
        # pyserial calls sockets by another scheme than the table profiles do.
        url = self._port.replace("tcp://", "socket://", 1) if self._port.startswith("tcp://") else self._port
        self._new = True
        return SerialLink(url, self._serial, "table")

    def _known(self) -> bool:
        """Whether the link is still the one on which the table said who it is."""
        return self._link is not None and not self._new

    def _settled(self) -> bool:
        """Whether what comes now answers what is asked now; asks the table, where that is not sure."""
        if self._known() and not self._unanswered:
            return True
        others = [line for line in self._questions if line not in self._unanswered]
        line = others[0] if others and self._known() else self._identity
        reply = self._exchange(line, self._questions[line], only=True)
        if reply is None:
            return False
        if line == self._identity and reply != (self._told or reply):
            self._drop()
            raise DeviceFaultError(
                f"table: '{quoted_text(reply)}' answers on {self._port} where '{quoted_text(self._told or '')}' did;"
                " nothing was told to it; check which adapter is plugged in where"
            )
        self._quieten()
        self._unanswered.clear()
        self._new = False
        return True

    def _send(self, line: str) -> None:
        link = self._link = self._link or self._open()
        wait = self._section.gap_s - (time.monotonic() - self._last_sent)
        if wait > 0.0:
            time.sleep(wait)
        try:
            while stale := link.read(0.0):
                self.heard = stale
            link.write(self._framing.request(line))
        except DeviceFaultError:
            self._drop()
            raise
        finally:
            self._last_sent = time.monotonic()

    def _exchange(self, line: str, answer: re.Pattern[str] | None, only: bool = False) -> str | None:
        """The reply to a line, None where none comes in time.

        only : nothing but what looks like `answer` is one; else one that looks otherwise is, where no better comes
        """
        self._send(line)
        link = self._link
        assert link is not None
        deadline = time.monotonic() + self._section.timeout_s
        other: str | None = None
        heard = b""
        while (left := deadline - time.monotonic()) > 0 and len(heard) < _LONGEST:
            try:
                data = link.read(left)
            except DeviceFaultError:
                self._drop()
                raise
            heard += data
            self.heard = data or self.heard
            while (found := self._framing.reply(line, heard)) is not None:
                said, heard = found
                if only:
                    if answer is not None and answer.search(said):
                        return said
                    continue
                other = said
                if self._refused and self._refused.search(said):
                    raise TextRefusalError(
                        f"table: '{line}' is refused with '{quoted_text(said)}'; look at the table's display, then"
                        " compare this line of the table profile with the controller's manual"
                    )
                if answer is None or answer.search(said):
                    return said
        if answer is not None or other is None:
            self._unanswered.append(line)
            if "://" in self._port:  # one that has died without a word
                self._drop()
            else:
                self._quieten()
        return other

    def _quieten(self) -> None:
        """Wait until nothing comes any more, for as long as an answer may take."""
        deadline = time.monotonic() + self._section.timeout_s
        while self._link is not None and time.monotonic() < deadline:
            try:
                if not self._link.read(QUIET):
                    return
            except DeviceFaultError:
                self._drop()

    def _not_answered(self, line: str) -> DeviceFaultError:
        return DeviceFaultError(
            f"table: '{line}' is not answered on {self._port} within {self._section.timeout_s:g} s;"
            " check cable, power, baud and the table profile"
        )

    def _drop(self) -> None:
        if self._link is not None:
            self._link.close()
        self._link = None
