"""Finds runs that did not reach their end and gives each the result that it could not write itself."""

import time
from pathlib import Path

from calstation.errors import InputError
from calstation.records.log import Log, open_log
from calstation.records.raw_log import STILL_WRITTEN, SUFFIX
from calstation.station.result import Ending, build_result, judge, write_json
from calstation.station.solve import StageChain


def settle_incomplete(folder: Path) -> list[Path]:
    """Write the result ``incomplete`` beside every log in `folder` whose run died; returns those logs.

    A log that cannot be read at all is left as it is.
    """
    found = []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        beside = path.with_suffix(".json")
        if beside.exists() or time.time() - path.stat().st_mtime < STILL_WRITTEN:
            continue
        try:
            log = open_log(path)
            if log.outcome is None:
                _settle(log, beside)
                found.append(path)
        except InputError:
            continue
    return found


def _settle(log: Log, beside: Path) -> None:
    prior = StageChain(log.meta).prior
    facts = log.facts()
    seconds = max(0, facts.last_seq - facts.first_seq + 1) / log.meta.imu.sample_rate_hz
    ending = Ending("incomplete", str(log.path), facts, seconds)
    result = build_result(log.meta, prior, (), judge(log.meta, prior, ()), ending)
    write_json(beside, result)
