"""A process that is killed at a statement of a database."""

import itertools
import os
from collections.abc import Callable

from sqlalchemy import Engine, event

#: Events that count as steps.
STEPS = ("before_cursor_execute", "after_cursor_execute", "commit")


def is_killed_at(number: int, action: Callable[[], object]) -> bool:
    """Perform `action` in a process that is killed at its step `number`; return False if it has fewer steps."""
    pid = os.fork()
    if pid == 0:
        count = itertools.count(1)

        def step(*_: object) -> None:
            if next(count) == number:
                os._exit(9)

        for name in STEPS:
            event.listen(Engine, name, step)
        action()
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 9
