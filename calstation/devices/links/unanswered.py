"""Requests that were not answered in time, whose late answers could be mistaken for those of later requests."""

from collections.abc import Callable, Hashable, Iterator

#: Host time without a byte after which a transmission counts as ended, s.
QUIET = 0.05

#: Unanswered requests that are remembered; a device that leaves more is not late but silent.
_MOST = 100


class Unanswered:
    """Signatures of the answers that may still come, oldest first: after an answer none to an older request comes."""

    def __init__(self) -> None:
        self._signatures: list[Hashable] = []

    def __contains__(self, signature: Hashable) -> bool:
        return signature in self._signatures

    def __iter__(self) -> Iterator[Hashable]:
        return iter(tuple(self._signatures))

    def __len__(self) -> int:
        return len(self._signatures)

    def add(self, signature: Hashable) -> None:
        """Record that the last request was not answered in time; its answer would have this signature."""
        self._signatures = [*self._signatures, signature][-_MOST:]

    def answered(self, signature: Hashable) -> None:
        """Record an answer with the last request's signature; it may belong to an older request with the same one."""
        self._signatures = [*self._after(signature.__eq__), signature] if signature in self._signatures else []

    def late(self, like: Callable[[Hashable], bool]) -> None:
        """Record an answer to an older request: to the oldest that it can belong to."""
        self._signatures = self._after(like)

    def forget_oldest(self) -> None:
        """Give up the oldest answer."""
        del self._signatures[:1]

    def _after(self, like: Callable[[Hashable], bool]) -> list[Hashable]:
        for i, signature in enumerate(self._signatures):
            if like(signature):
                return self._signatures[i + 1 :]
        return self._signatures
