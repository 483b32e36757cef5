"""A simulated unit whose registers are written by a possibly wrong profile, with captures before and after."""

import struct
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from calstation.bench.config import BenchConfig
from calstation.bench.imu.unit import WRITE, ImuUnit
from calstation.bench.live import UNITS
from calstation.bench.truth.simulate import BenchTruth, Simulator
from calstation.devices.codecs.frame_checks import check_bytes
from calstation.devices.codecs.numbers import number
from calstation.devices.imu.registers import RegisterMap
from calstation.devices.imu.vectornav_imu import line
from calstation.devices.profiles.imu import ImuProfile
from calstation.estimation.common.context import ImuModel, Site, SolveContext, TableModel
from calstation.physics.arrays import FloatArray
from calstation.physics.motion import Dwell
from calstation.physics.parameters import NAMES, PARAMETERS
from calstation.physics.table import JointLimits, TableGeometry
from calstation.registers.verification import AppliedRegisters, VerificationCheck, verify_output
from calstation.schema import validate
from calstation.sequencer.capture import SHORT_REST, mean_at_rest
from calstation.sequencer.verification_path import Turned, VerificationData, verification_path

IMUS = Path(__file__).parents[2] / "data" / "imus"
GRADES = ("nav", "tactical", "mems")
LIMITS = JointLimits((-19.0, -19.0), (19.0, 19.0), (2.0, 2.0), (3.0, 3.0))
GEOMETRY = TableGeometry(limits=LIMITS)
SITE = Site(np.deg2rad(34.25), np.deg2rad(108.9), 400.0)
REPEATABILITY = np.deg2rad(0.0005)
RATE = 200.0


def profile_data(name: str) -> dict[str, Any]:
    """Return the data of a shipped profile, to be changed."""
    data: dict[str, Any] = tomllib.loads((IMUS / f"{name}.toml").read_text(encoding="utf-8"))
    return data


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
        self._steps: list[list[Any]] = [[Dwell(SHORT_REST)]]
        for leg in self.path.legs:
            self._steps.append([leg.move, Dwell(0.1)])
            if leg.rest or leg.opposite:
                self._steps.append([Dwell(SHORT_REST)])

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
        self.context = SolveContext(
            SITE,
            ImuModel(
                "SN-1", RATE, imu.output, imu.gyro_lsb, imu.accel_lsb, imu.gyro_arw, imu.accel_vrw,
                imu.gyro_bias_instability, imu.accel_bias_instability,
            ),
            TableModel(),
        )  # fmt: skip

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
        turned = tuple(Turned(*of) for of in zip(path.turns, integrals, seconds, strict=True))
        return VerificationData((*rests, *(opposites if corrected else ())), SHORT_REST, turned, corrected=corrected)

    def _output(self, counts: FloatArray, *, corrected: bool) -> FloatArray:
        values = counts * self.scale
        return self.unit.correction().applied(values) if corrected else values

    def verified(self, wrong: ImuProfile, values: Mapping[str, float]) -> tuple[VerificationCheck, ...]:
        """Write values by a profile, capture before and after, and compare."""
        entries = RegisterMap(tuple(wrong.registers))
        meant = entries.rounded({name: values[name] for name in entries.parameters})
        fill(self.unit, wrong, entries.encode(meant))
        reference = self.capture(corrected=False)
        fresh = replace(self.capture(corrected=True), reference=reference)
        prior = np.diag([(0.0 if p.group == "outer_lever" else 1e-5) ** 2 for p in PARAMETERS])
        left = [0.0 if name in entries.parameters else values[name] for name in NAMES]
        covariance = prior + np.diag(np.square(left))
        return verify_output(fresh, AppliedRegisters(meant), covariance, self.context, REPEATABILITY)


def fill(unit: ImuUnit, wrong: ImuProfile, numbers: Mapping[int, list[float]]) -> None:
    """Write numbers to registers by the unit's own commands, with the types and byte orders of the entries."""
    check_cancelled = unit.conversation()
    for entry in wrong.registers:
        kind = number(entry.type)
        if wrong.protocol == "vectornav":
            values_text = ",".join(f"{value:.9G}" for value in numbers[entry.key])
            assert b"VNERR" not in b"".join(check_cancelled(line(f"VNWRG,{entry.address},{values_text}", "xor8"), 1.0))
            continue
        order = entry.byte_order or ("big" if wrong.modbus else "little")
        body = b"".join(kind.pack(value, order, entry.word_order) for value in numbers[entry.key])
        if wrong.protocol == "framed":
            unit.answer(WRITE, struct.pack("<HB", entry.address, len(body) // 4) + body, 1.0)
            continue
        for request in (
            bytes([1, 6]) + struct.pack(">HH", 23, entry.page),
            bytes([1, 16]) + struct.pack(">HHB", entry.address, len(body) // 2, len(body)) + body,
        ):
            (reply,) = check_cancelled(request + check_bytes("crc16_modbus", request, "little"), 1.0)
            assert not reply[1] & 0x80
