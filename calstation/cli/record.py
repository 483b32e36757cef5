"""`record`: a recording of the virtual bench that no rate table makes, and its truth beside it."""

import json
from pathlib import Path
from typing import cast, get_args

from rich.console import Console

from calstation.errors import ConfigurationError
from calstation.records.raw_log import SUFFIX
from calstation.simulation.bench_recordings import GradeName, Kind, make_recording
from calstation.simulation.recordings import truth_path


def record_command(kind: str, target: Path, grade: str, seed: int) -> int:
    """Write the raw log `target` and its truth as NAME.truth.json."""
    for option, value, known in (("KIND", kind, get_args(Kind)), ("--grade", grade, get_args(GradeName))):
        if value not in known:
            raise ConfigurationError(f"{option} '{value}' is unknown; choose from {', '.join(known)}")
    if target.suffix != SUFFIX:
        raise ConfigurationError(f"{target}: a raw log's name ends in {SUFFIX}; rename the target")
    facts, truth = make_recording(cast(Kind, kind), target, cast(GradeName, grade), seed)
    beside = truth_path(target)
    try:
        beside.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    except OSError as exc:
        raise ConfigurationError(f"{beside}: cannot be written ({exc.strerror or exc})") from exc
    Console(stderr=True).print(
        f"{target}: {facts.samples} samples; truth in {beside}", highlight=False, markup=False
    )
    return 0
