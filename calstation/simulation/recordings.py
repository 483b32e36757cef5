"""Background job that makes a recording on the virtual bench, together with a file of its true parameters."""

import json
from pathlib import Path
from typing import cast

from calstation.config import site_folder
from calstation.errors import ConfigurationError
from calstation.jobs import ProgressCallback
from calstation.messages import os_reason
from calstation.records import truth_path, write_atomic


def recordings_folder() -> Path:
    """Return the folder in which the window saves recordings of the virtual bench."""
    return site_folder() / "recordings"


def record_on_bench(progress: ProgressCallback, kind: str, path: Path, grade: str, seed: int) -> Path:
    """Job: write a recording and the file with its true parameters, replacing existing files.

    Raises ConfigurationError if the file cannot be written.
    """
    from calstation.simulation.bench_recordings import GradeName, Kind, make_recording  # slow to import

    progress(0.0)
    partial = path.with_name(f".{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.unlink(missing_ok=True)
        _, truth = make_recording(cast(Kind, kind), partial, cast(GradeName, grade), seed)
        progress(0.9)
        write_atomic(truth_path(path), json.dumps(truth, indent=1) + "\n")
        partial.replace(path)
    except OSError as exc:
        raise ConfigurationError("csv.not_written", file=path, reason=os_reason(exc)) from exc
    return path
