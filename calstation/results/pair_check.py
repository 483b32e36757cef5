"""Work for the workshop: follow a recording of IMUs on one body as it would be followed live, and tell how it goes."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calstation.estimation.pairs.watch import PairWatch, WatchEvent, check_values
from calstation.records.csv_log import estimated_rows
from calstation.records.log import open_log
from calstation.records.meta import context_from_meta
from calstation.records.raw_log import SUFFIX
from calstation.records.raw_read import row_count
from calstation.results.pair_run import pair_folder, watch_log
from calstation.results.plots.pairs import Happening, Kept, kept_pairs


@dataclass(frozen=True)
class Followed:
    """How far a recording has been followed.

    Attributes
    ----------
    time, duration : s followed, and of the whole recording
    state : waiting, checking or calibrating; motion : collected of what a calibration wants, 0 to 1
    happened : so far, in order
    """

    time: float
    duration: float
    state: str
    motion: float
    happened: tuple[Happening, ...]

    def to_note(self) -> str:
        """As the text that travels with a job's progress."""
        happened = [(h.kind, h.time, h.number, dict(h.values)) for h in self.happened]
        return json.dumps([self.time, self.duration, self.state, self.motion, happened])


def followed_from_note(note: str) -> Followed | None:
    """What `Followed.to_note` told; None for any other note."""
    if not note.startswith("["):
        return None
    time, duration, state, motion, happened = json.loads(note)
    return Followed(time, duration, state, motion, tuple(Happening(*each) for each in happened))


@dataclass(frozen=True)
class PairChecked:
    """A recording followed to its end: the last check of each secondary by number, and what is kept of it now."""

    followed: Followed
    checks: Mapping[int, Mapping[str, Any]]
    kept: tuple[Kept, ...]

    @property
    def calibrated(self) -> frozenset[int]:
        """Numbers of the secondaries that were off and have been calibrated."""
        return frozenset(h.number for h in self.followed.happened if h.kind == "calibrated")


def check_pair(tell: Callable[..., None], path: Path) -> PairChecked:
    """Check at the first rest, calibrate what is off, and keep what was found in the site's own folder.

    Raises InputError or ConfigurationError with file, field and mend.
    """
    log = open_log(path)
    rows = max(1, row_count(path) if path.suffix == SUFFIX else estimated_rows(path))
    duration = rows / log.meta.imu.sample_rate_hz
    begin: list[float] = []
    happened: list[Happening] = []

    def since_begin(time: float) -> float:
        if not begin:
            begin.append(time)
        return time - begin[0]

    def heard(event: WatchEvent) -> None:
        happened.append(Happening(event.kind, since_begin(event.time), event.number, event.values))

    last = 0.0

    def look(time: float, watch: PairWatch) -> None:
        nonlocal last
        now = last = since_begin(time)
        state = Followed(now, duration, watch.state, watch.progress, tuple(happened))
        tell(min(now / duration, 0.99), note=state.to_note())

    tell(0.0)
    watched = watch_log(path, pair_folder(), True, heard, look)
    end = Followed(last, last, "waiting", 0.0, tuple(happened))
    checks = {number: check_values(check) for number, check in watched.checks.items()}
    return PairChecked(end, checks, kept_pairs(context_from_meta(log.meta), pair_folder()))
