"""Requests that were not answered in time: what may still be on its way, and would be taken for another's answer."""

from collections.abc import Callable, Hashable, Iterator

#: Host time without a byte after which nothing is being sent any more, s.
QUIET = 0.05

#: Unanswered requests that are kept in mind; a device that leaves more is not answering late, it is silent.
_MOST = 100


class Unanswered:
    """What the answers look like that may still come, those of the oldest requests first.

    A device answers in the order in which it was asked: an answer shows that none to an older request will come.
    """

    def __init__(self) -> None:
        self._looks: list[Hashable] = []

    def __contains__(self, look: Hashable) -> bool:
        return look in self._looks

    def __iter__(self) -> Iterator[Hashable]:
        return iter(tuple(self._looks))

    def __len__(self) -> int:
        return len(self._looks)

    def add(self, look: Hashable) -> None:
        """The last request was not answered in time; its answer would look like this."""
        self._looks = [*self._looks, look][-_MOST:]

    def answered(self, look: Hashable) -> None:
        """What looks like the last request's answer came; it may be that to an older one which would look alike."""
        self._looks = [*self._after(look.__eq__), look] if look in self._looks else []

    def late(self, like: Callable[[Hashable], bool]) -> None:
        """An answer to an older request came, to the oldest of those that it could be to."""
        self._looks = self._after(like)

    def forget_oldest(self) -> None:
        """Give up the answer that has been due for longest."""
        del self._looks[:1]

    def _after(self, like: Callable[[Hashable], bool]) -> list[Hashable]:
        for i, look in enumerate(self._looks):
            if like(look):
                return self._looks[i + 1 :]
        return self._looks
