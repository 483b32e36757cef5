"""Recordings made on the virtual bench as a work for the workshop, and where they lie with the truth that drew them."""

import json
from pathlib import Path
from typing import cast

from calstation.config.library import site_folder
from calstation.errors import ConfigurationError
from calstation.jobs.queue import ProgressCallback
from calstation.records.atomic import write_atomic


def recordings_folder() -> Path:
    """Where the window puts recordings of the virtual bench."""
    return site_folder() / "recordings"


def record_on_bench(tell: ProgressCallback, kind: str, path: Path, grade: str, seed: int) -> Path:
    """Work for the workshop: make a recording with its truth beside it; both replace what was there.

    Returns its path. Raises ConfigurationError where the place cannot be written.
    """
    from calstation.simulation.bench_recordings import (  # the bench takes long to import
        GradeName,
        Kind,
        make_recording,
    )

    tell(0.0)
    partial = path.with_name(f".{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.unlink(missing_ok=True)
        _, truth = make_recording(cast(Kind, kind), partial, cast(GradeName, grade), seed)
        tell(0.9)
        write_atomic(truth_path(path), json.dumps(truth, indent=1) + "\n")
        partial.replace(path)
    except OSError as exc:
        raise ConfigurationError(
            f"{path}: cannot be written ({exc.strerror or exc}); choose another folder"
        ) from exc
    return path


def truth_path(path: Path) -> Path:
    """Where the truth of a recording lies."""
    return path.with_suffix(".truth.json")


def read_truth(path: Path) -> dict[str, float]:
    """What drew a recording of the virtual bench, from the file beside it; nothing where there is none."""
    try:
        found = json.loads(truth_path(path).read_text(encoding="utf-8"))
        return {str(name): float(value) for name, value in found.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}
