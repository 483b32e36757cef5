"""Transactions with a device, in which a late reply is not mistaken for the reply to a later request."""

import time
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from calstation.devices.codecs import Reply

#: Host time without a byte after which a transmission is considered complete, s.
QUIET_TIME = 0.05

#: Maximum number of recorded transactions; a device that leaves more requests unanswered is silent rather than late.
_MAX_UNANSWERED = 100

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class Refusal(Exception):  # noqa: N818 - a reply of the device
    """The device refuses a command; the exceptions of all protocols are derived from this class."""


@dataclass(frozen=True)
class Transaction(Generic[T_co]):
    """A request and its expected reply.

    request : bytes to send
    signature : key of the reply; replies with equal signatures cannot be distinguished
    parse : function that returns the content of a reply, or None if it belongs to another request; raises Refusal
    """

    request: bytes
    signature: Hashable
    parse: Callable[[Reply], T_co | None]


class Dialogue:
    """The transactions with a device, and the signatures of replies that may still arrive.

    If a late reply may have the signature of a transaction, the request is sent only after the device has replied to a
    request with another signature: after this reply, no reply to an earlier request can arrive.

    Parameters
    ----------
    send : function that sends bytes
    receive : function that waits for replies for at most the given host time, s; it returns None if nothing arrives
    other_transactions : function that yields transactions with different signatures, for synchronisation
    may_belong : function that returns whether a reply may belong to a transaction with a signature; the last argument
        is True for a refusal
    """

    def __init__(
        self,
        send: Callable[[bytes], None],
        receive: Callable[[float], list[Reply] | None],
        other_transactions: Callable[[], Iterator[Transaction[object]]],
        may_belong: Callable[[Reply, Hashable, bool], bool],
    ) -> None:
        self._send, self._receive = send, receive
        self._other_transactions, self._may_belong = other_transactions, may_belong
        #: Signatures of the replies that may still arrive, oldest first.
        self.unanswered: list[Hashable] = []

    def ask(
        self, transaction: Transaction[T], timeout: float, *, urgent: bool = False, again: bool = False
    ) -> T | None:
        """Send a request once and return the content of its reply; None if no reply arrives. Raises Refusal.

        Parameters
        ----------
        transaction : the request and its expected reply
        timeout : host time for a reply, s
        urgent : whether the request, e.g. a stop, is sent immediately and again once late replies have arrived
        again : whether the same request was sent just before, so that the reply to either request confirms it
        """
        if transaction.signature in self.unanswered and not again:
            if urgent:
                self._send(transaction.request)
                self._add(transaction)
            self._discard_late(QUIET_TIME, timeout)
            if transaction.signature in self.unanswered and not self._is_synchronised(timeout):
                return None
        return self._attempt(transaction, timeout)

    def other_transaction(self) -> Transaction[object] | None:
        """Return a transaction to which no late reply can belong; discard the oldest signatures if necessary."""
        while True:
            for transaction in self._other_transactions():
                if transaction.signature not in self.unanswered:
                    return transaction
            if not self.unanswered:
                return None
            del self.unanswered[0]

    def _is_synchronised(self, timeout: float) -> bool:
        """Send the request of another transaction, and return whether its reply arrives."""
        transaction = self.other_transaction()
        try:
            return transaction is None or self._attempt(transaction, timeout) is not None
        except Refusal:  # a refusal is also a reply
            return True

    def _attempt(self, transaction: Transaction[T], timeout: float) -> T | None:
        self._discard_late(0.0, timeout)
        self._send(transaction.request)
        deadline = time.monotonic() + timeout
        while (remaining := deadline - time.monotonic()) > 0:
            for reply in self._receive(remaining) or ():
                try:
                    content = transaction.parse(reply)
                except Refusal:
                    refused = {s for s in self.unanswered if self._may_belong(reply, s, True)}
                    if refused <= {transaction.signature}:
                        self._note_reply(transaction)
                        raise
                    self._note_late(reply, refusal=True)
                    continue
                if content is not None:
                    self._note_reply(transaction)
                    return content
                self._note_late(reply)
        self._add(transaction)
        return None

    def _discard_late(self, quiet: float, timeout: float) -> None:
        """Receive late replies until none arrives for `quiet` s, but for at most `timeout` s of host time."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline and (replies := self._receive(quiet)) is not None:
            for reply in replies:
                self._note_late(reply)

    def _add(self, transaction: Transaction[object]) -> None:
        self.unanswered = [*self.unanswered, transaction.signature][-_MAX_UNANSWERED:]

    def _note_reply(self, transaction: Transaction[object]) -> None:
        """Record a reply to the last request, or to an older request with the same signature."""
        signature, older = transaction.signature, self.unanswered
        self.unanswered = [*older[older.index(signature) + 1 :], signature] if signature in older else []

    def _note_late(self, reply: Reply, *, refusal: bool = False) -> None:
        """Record a reply to the oldest request to which it may belong; earlier replies can no longer arrive."""
        for i, signature in enumerate(self.unanswered):
            if self._may_belong(reply, signature, refusal):
                self.unanswered = self.unanswered[i + 1 :]
                return
