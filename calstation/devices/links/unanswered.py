"""Record of unanswered requests, whose late replies could be mistaken for replies to later requests."""

from collections.abc import Callable, Hashable, Iterator

#: Host time without a byte after which a transmission is considered complete, s.
QUIET = 0.05

#: Largest number of recorded requests; a device that leaves more unanswered is silent rather than late.
_MAX_REQUESTS = 100


class Unanswered:
    """Signatures of replies that may still arrive, oldest first; a reply rules out later replies to older requests."""

    def __init__(self) -> None:
        self._signatures: list[Hashable] = []

    def __contains__(self, signature: Hashable) -> bool:
        return signature in self._signatures

    def __iter__(self) -> Iterator[Hashable]:
        return iter(tuple(self._signatures))

    def __len__(self) -> int:
        return len(self._signatures)

    def add(self, signature: Hashable) -> None:
        """Record that the last request was not answered in time; its reply would have this signature."""
        self._signatures = [*self._signatures, signature][-_MAX_REQUESTS:]

    def answered(self, signature: Hashable) -> None:
        """Record a reply with the last request's signature; it may belong to an older request with the same one."""
        self._signatures = [*self._after(signature.__eq__), signature] if signature in self._signatures else []

    def late(self, like: Callable[[Hashable], bool]) -> None:
        """Record a reply to an older request, namely to the oldest one to which it can belong."""
        self._signatures = self._after(like)

    def forget_oldest(self) -> None:
        """Stop expecting the oldest reply."""
        del self._signatures[:1]

    def _after(self, like: Callable[[Hashable], bool]) -> list[Hashable]:
        for i, signature in enumerate(self._signatures):
            if like(signature):
                return self._signatures[i + 1 :]
        return self._signatures
