"""A simulated unit whose registers are written by a possibly wrong profile, with captures before and after."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from calstation.bench import BenchConfig
from calstation.bench.imu import UNITS
from calstation.bench.truth import BenchTruth, Simulator
from calstation.config import library
from calstation.devices.imu import RegisterMap
from calstation.devices.profiles import ImuProfile
from calstation.estimation.common import Site, SolveContext, TableModel
from calstation.physics import NAMES, PARAMETERS, Dwell, FloatArray, JointLimits, TableGeometry
from calstation.registers import AppliedRegisters, verify_output
from calstation.registers.verification import VerificationCheck
from calstation.schema import read_toml, validate
from calstation.sequencer import TurnData, VerificationData, mean_at_rest
from calstation.sequencer.capture import TABLE_REST
from calstation.sequencer.verification_path import verification_path
from tests.devices.powered_unit import write_directly
from tests.imu_models import imu_model

GRADES = ("nav", "tactical", "mems")
LIMITS = JointLimits((-19.0, -19.0), (19.0, 19.0), (2.0, 2.0), (3.0, 3.0))
GEOMETRY = TableGeometry(limits=LIMITS)
SITE = Site(np.deg2rad(34.25), np.deg2rad(108.9), 400.0)
REPEATABILITY = np.deg2rad(0.0005)
RATE = 200.0


def profile_data(protocol: str) -> dict[str, Any]:
    """Return the data of the shipped profile of a protocol, to be changed."""
    return read_toml(library.find("imus", UNITS[protocol].profile))


def profile(data: dict[str, Any]) -> ImuProfile:
    """Return a changed profile whose prior allows every register value."""
    wide = {**data, "prior": {g: {"sigma": 1e-3 if "lever" in g else 1e-5} for g in data["prior"]}}
    for entry in wide["registers"]:
        entry["range"] = [-1.9, 1.9] if str(entry.get("type", "")).startswith("q") else [-0.9, 1.9]
        if entry.get("type") in ("i16", "i32"):
            entry["range"] = [-1.0, 1.0]
    return validate(ImuProfile, wide, "profile")


def truth(grade: str, seed: int, output: str, larger: float = 1.0) -> BenchTruth:
    """Return the truth of a random bench with unit errors multiplied by `larger`."""
    site = {"latitude_deg": float(np.rad2deg(SITE.latitude)), "height_m": SITE.height}
    drawn = BenchConfig.model_validate({"grade": grade, "seed": seed, "output": output, **site}).truth()
    return replace(drawn, imu=replace(drawn.imu, parameters=larger * drawn.parameters))


class Recording:
    """The output of a simulated unit along the verification path, simulated once for all tests."""

    def __init__(self, bench: BenchTruth, seed: int) -> None:
        self.bench = bench
        self.path = verification_path((0.0, 0.0), GEOMETRY, LIMITS)
        self._simulator = Simulator(bench, seed)
        self._captures: list[list[FloatArray]] = []
        self._steps: list[list[Any]] = [[Dwell(TABLE_REST)]]
        for leg in self.path.legs:
            self._steps.append([leg.move, Dwell(0.1)])
            if leg.rest or leg.opposite:
                self._steps.append([Dwell(TABLE_REST)])

    def capture(self, number: int) -> list[FloatArray]:
        """Return the counts of each part of capture `number`, starting at 0."""
        while len(self._captures) <= number:
            self._captures.append([self._simulator.run(steps, "look").counts for steps in self._steps])
        return self._captures[number]


@cache
def recording(grade: str, seed: int, output: str, larger: float = 1.0) -> Recording:
    """Return the recording of a random bench."""
    return Recording(truth(grade, seed, output, larger), seed)


class Captures:
    """One bench and its unit, captured repeatedly along the same path."""

    def __init__(self, protocol: str, recording: Recording) -> None:
        self.bench = recording.bench
        imu = self.bench.imu
        per_count = RATE if imu.output == "increment" else 1.0
        self.scale = np.repeat([imu.gyro_lsb, imu.accel_lsb], 3) * per_count
        self.unit = UNITS[protocol](BenchConfig(serial="SN-1"))
        self._recording, self._taken = recording, 0
        self.context = SolveContext(SITE, imu_model(imu, "SN-1"), TableModel())

    def capture(self, *, corrected: bool) -> VerificationData:
        """Return rests and rotations, as captured by a verification."""
        parts = iter(self._recording.capture(self._taken))
        self._taken += 1
        path = self._recording.path
        rests, opposites = [mean_at_rest(self._output(next(parts), corrected=corrected))], []
        integrals = [np.zeros(6) for _ in path.turns]
        seconds = [0.0 for _ in path.turns]
        for leg in path.legs:
            moved = self._output(next(parts), corrected=corrected)
            if leg.turn is not None:
                integrals[leg.turn] += moved.sum(axis=0) / RATE
                seconds[leg.turn] += len(moved) / RATE
            if leg.rest or leg.opposite:
                rest = mean_at_rest(self._output(next(parts), corrected=corrected))
                (rests if leg.rest else opposites).append(rest)
        turned = tuple(TurnData(*of) for of in zip(path.turns, integrals, seconds, strict=True))
        return VerificationData((*rests, *(opposites if corrected else ())), TABLE_REST, turned, corrected=corrected)

    def _output(self, counts: FloatArray, *, corrected: bool) -> FloatArray:
        values = counts * self.scale
        return self.unit.correction().apply(values) if corrected else values

    def verified(self, wrong: ImuProfile, values: Mapping[str, float]) -> tuple[VerificationCheck, ...]:
        """Write values by a profile, capture before and after, and compare."""
        entries = RegisterMap(tuple(wrong.registers))
        meant = entries.rounded({name: values[name] for name in entries.parameters})
        write_directly(self.unit, wrong, meant)
        reference = self.capture(corrected=False)
        fresh = replace(self.capture(corrected=True), reference=reference)
        prior = np.diag([(0.0 if p.group == "outer_lever" else 1e-5) ** 2 for p in PARAMETERS])
        left = [0.0 if name in entries.parameters else values[name] for name in NAMES]
        covariance = prior + np.diag(np.square(left))
        return verify_output(fresh, AppliedRegisters(meant), covariance, self.context, REPEATABILITY)
