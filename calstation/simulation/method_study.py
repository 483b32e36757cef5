"""Monte Carlo study of single methods: simulated recordings are solved and compared with the truth."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np

from calstation.errors import ConfigurationError
from calstation.physics import INDEX, PARAMETERS, further_parameter
from calstation.results import resolve
from calstation.simulation.bench_recordings import GradeName, Kind, make_recording
from calstation.simulation.study_table import chi_squared_band
from calstation.simulation.temperature_study import OVER_TEMPERATURE, study_temperature

#: Kind of recording for each method.
RECORDING_KINDS: dict[str, Kind] = {"multi_position": "hand", "cross_calibration": "pair", "gimbal": "gimbal"}


def grades_of(stage: str) -> tuple[GradeName, ...]:
    """Return the grades of the units that a study of a method simulates by default."""
    return tuple(OVER_TEMPERATURE.get(stage, get_args(GradeName)))


def run_method_study(
    stage: str, grade: GradeName, seeds: int, progress: Callable[[int, int], None] = lambda done, count: None
) -> dict[str, Any]:
    """Study one method; return JSON data.

    The data contain for each group the rms sigma (SI), the rms of error/sigma over units and axes with its 99.9 % band,
    the largest error/sigma, and whether the rms is within the band. At most three axes per group are counted for the
    band, because they have the same motion. Raises ConfigurationError if there is no recording for the method.

    Parameters
    ----------
    stage : name of the method's stage
    grade : grade of the simulated units
    seeds : number of units
    progress : callback with the number of finished units and the number of all units
    """
    if stage in OVER_TEMPERATURE:
        return study_temperature(stage, grade, seeds, progress)
    if stage not in RECORDING_KINDS:
        raise ConfigurationError("study.unknown_method", method=stage, methods=[*RECORDING_KINDS, *OVER_TEMPERATURE])
    errors: dict[str, list[list[float]]] = {}
    sigmas: dict[str, list[float]] = {}
    nis: list[float] = []
    for seed in range(seeds):
        for group, pairs in _unit(stage, grade, seed, nis).items():
            errors.setdefault(group, []).append([e / s for e, s in pairs])
            sigmas.setdefault(group, []).extend(s for _, s in pairs)
        progress(seed + 1, seeds)
    groups = {}
    for group, rows in errors.items():
        values = np.array(rows)
        count = len(values) * min(values.shape[1], 3)
        low, high = np.sqrt(chi_squared_band(count))
        rms = float(np.sqrt(np.mean(values**2)))
        groups[group] = {
            "sigma": float(np.sqrt(np.mean(np.square(sigmas[group])))),
            "rms": rms,
            "low": float(low),
            "high": float(high),
            "largest": float(np.abs(values).max()),
            "passed": bool(low <= rms <= high),
        }
    return {
        "method": stage,
        "grade": grade,
        "units": seeds,
        "groups": groups,
        "consistency": float(np.mean(nis)),
        "passed": all(g["passed"] for g in groups.values()),
    }


def _unit(stage: str, grade: GradeName, seed: int, nis: list[float]) -> dict[str, list[tuple[float, float]]]:
    """Return error and sigma of each parameter of one unit, by group; append the unit's mean NIS to `nis`."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "recording.h5"
        _, truth = make_recording(RECORDING_KINDS[stage], log, grade, seed)
        result = resolve(log, (stage,)).result
    nis.append(result.consistency[stage].nis_mean)
    errors: dict[str, list[tuple[float, float]]] = {}
    for name, row in result.parameters.items():
        pair = further_parameter(name)
        group = pair.group if pair is not None else PARAMETERS[INDEX[name]].group
        errors.setdefault(group, []).append((row.value - truth[name], row.sigma))
    return errors
