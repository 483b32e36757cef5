"""The exchange process of the user interface or a run: `python -m calstation.database`.

The first line of JSON on standard input specifies the work. Each later line contains the units to claim and replaces
the previous ones.
"""

import json
import logging
import os
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from calstation import applog
from calstation.database.process import watch

#: Longest duration of the last exchange after the end of the owner, s.
_LAST_EXCHANGE_S = 10.0

logger = logging.getLogger(__name__)


class _Owner:
    """Input from the owner of the process, read in a thread so that the program can wait for it with a time limit."""

    def __init__(self) -> None:
        self._lines = SimpleQueue[dict[str, Any] | None]()
        threading.Thread(target=self._read, daemon=True).start()
        self.work = self._lines.get()
        self.claimed = self.work.pop("claimed") if self.work else {}

    def _read(self) -> None:
        with suppress(ValueError):  # a line truncated by the end of the owner
            for line in sys.stdin.buffer:
                self._lines.put(json.loads(line))
        self._lines.put(None)
        time.sleep(_LAST_EXCHANGE_S)
        os._exit(0)  # terminate an exchange that hangs; files and database remain consistent

    def wait(self, seconds: float) -> bool:
        """Wait for a change of the units to claim; return whether the owner has ended."""
        try:
            line = self._lines.get(timeout=seconds)
            while line is not None:
                self.claimed = line
                line = self._lines.get_nowait()
        except Empty:
            return False
        return True


def _main() -> None:
    """Exchange runs until the owner closes the pipe or ends, and then once more."""
    applog.configure("exchange")
    owner = _Owner()
    if owner.work is None:
        return
    folder = Path(owner.work.pop("folder"))
    try:
        watch(folder, wait=owner.wait, claimed=lambda: owner.claimed, **owner.work)
    except Exception:
        logger.exception("the exchange ended with a programming error")
        raise


_main()
