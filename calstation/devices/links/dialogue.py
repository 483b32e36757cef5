"""Questions to a device, of which late replies are not mistaken for replies to later questions."""

import time
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from calstation.devices.codecs import Reply

#: Host time without a byte after which a transmission is considered complete, s.
QUIET_TIME = 0.05

#: Maximum number of recorded questions; a device with more unanswered questions is silent rather than late.
_MAX_UNANSWERED = 100

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class Refusal(Exception):  # noqa: N818 - a reply of the device
    """The device refuses a command; base of the exceptions of all protocols."""


@dataclass(frozen=True)
class Question(Generic[T_co]):
    """A command that expects a reply.

    request : bytes to send
    signature : key of the reply; replies with equal signatures cannot be distinguished
    take : returns the content of a reply, or None if it belongs to another command; raises Refusal
    """

    request: bytes
    signature: Hashable
    take: Callable[[Reply], T_co | None]


class Dialogue:
    """The questions to a device, and the signatures of replies that may still arrive.

    If a late reply may have the signature of a question, the question is sent only after the device has replied to a
    question with another signature, because no earlier reply can arrive after this reply.

    Parameters
    ----------
    send : sends bytes
    receive : waits at most the given host time, s, for replies and returns them, or None if nothing arrives
    other_questions : yields questions with different signatures to which the device replies
    may_belong : returns whether a reply may belong to a question with a signature; the last argument is True for a
        refusal
    """

    def __init__(
        self,
        send: Callable[[bytes], None],
        receive: Callable[[float], list[Reply] | None],
        other_questions: Callable[[], Iterator[Question[object]]],
        may_belong: Callable[[Reply, Hashable, bool], bool],
    ) -> None:
        self._send, self._receive = send, receive
        self._other_questions, self._may_belong = other_questions, may_belong
        #: Signatures of the replies that may still arrive, oldest first.
        self.unanswered: list[Hashable] = []

    def ask(self, question: Question[T], timeout: float, *, urgent: bool = False, again: bool = False) -> T | None:
        """Send a question once and return the content of its reply, or None without a reply. Raises Refusal.

        Parameters
        ----------
        question : the question
        timeout : host time for a reply, s
        urgent : whether the command, e.g. a stop, is sent immediately and again once late replies have arrived
        again : whether the same command was sent just before, so that the reply to either one confirms it
        """
        if question.signature in self.unanswered and not again:
            if urgent:
                self._send(question.request)
                self._add(question)
            self._discard_late(QUIET_TIME, timeout)
            if question.signature in self.unanswered and not self._is_synchronised(timeout):
                return None
        return self._attempt(question, timeout)

    def other_question(self) -> Question[object] | None:
        """Return a question to which no late reply can belong, if necessary by discarding the oldest signatures."""
        while True:
            for question in self._other_questions():
                if question.signature not in self.unanswered:
                    return question
            if not self.unanswered:
                return None
            del self.unanswered[0]

    def _is_synchronised(self, timeout: float) -> bool:
        """Send another question, and return whether its reply arrives."""
        question = self.other_question()
        try:
            return question is None or self._attempt(question, timeout) is not None
        except Refusal:  # a refusal is also a reply
            return True

    def _attempt(self, question: Question[T], timeout: float) -> T | None:
        self._discard_late(0.0, timeout)
        self._send(question.request)
        deadline = time.monotonic() + timeout
        while (remaining := deadline - time.monotonic()) > 0:
            for reply in self._receive(remaining) or ():
                try:
                    content = question.take(reply)
                except Refusal:
                    refused = {s for s in self.unanswered if self._may_belong(reply, s, True)}
                    if refused <= {question.signature}:
                        self._note_reply(question)
                        raise
                    self._note_late(reply, refusal=True)
                    continue
                if content is not None:
                    self._note_reply(question)
                    return content
                self._note_late(reply)
        self._add(question)
        return None

    def _discard_late(self, quiet: float, timeout: float) -> None:
        """Receive late replies until none arrives for `quiet` s, at most for `timeout` s, host time."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline and (replies := self._receive(quiet)) is not None:
            for reply in replies:
                self._note_late(reply)

    def _add(self, question: Question[object]) -> None:
        self.unanswered = [*self.unanswered, question.signature][-_MAX_UNANSWERED:]

    def _note_reply(self, question: Question[object]) -> None:
        """Record a reply to the last question, or to an older question with the same signature."""
        signature, older = question.signature, self.unanswered
        self.unanswered = [*older[older.index(signature) + 1 :], signature] if signature in older else []

    def _note_late(self, reply: Reply, *, refusal: bool = False) -> None:
        """Record a reply to the oldest question to which it may belong; earlier replies can no longer arrive."""
        for i, signature in enumerate(self.unanswered):
            if self._may_belong(reply, signature, refusal):
                self.unanswered = self.unanswered[i + 1 :]
                return
