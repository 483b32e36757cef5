"""The truth of one bench: a unit, a table and its encoders, drawn from a seed."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calstation.bench.truth.drive import EncoderTruth
from calstation.bench.truth.grades import GradeName, draw_imu
from calstation.bench.truth.imu import ImuTruth
from calstation.bench.truth.table import TableTruth
from calstation.physics import FloatArray

ARCSECOND = np.deg2rad(1.0 / 3600.0)


@dataclass(frozen=True)
class BenchTruth:
    """True values of everything that the station estimates.

    Attributes
    ----------
    imu, table, encoder : the true unit, table and encoders
    grade : of the unit
    azimuth : azimuth in the station file, rad; the true one is `table.azimuth`
    outer_lever : "estimated" or "fixed" at 0
    """

    imu: ImuTruth
    table: TableTruth
    encoder: EncoderTruth
    grade: GradeName
    azimuth: float
    outer_lever: str

    @property
    def parameters(self) -> FloatArray:
        """The 30 true parameters in the order of `physics.parameters`, SI, shape (30,)."""
        return self.imu.parameters

    @classmethod
    def draw(
        cls,
        grade: GradeName,
        seed: int,
        *,
        latitude: float = np.deg2rad(34.25),
        height: float = 400.0,
        azimuth: float = 0.0,
        gravity: float | None = None,
        outer_axis: tuple[float, float, float] = (1.0, 0.0, 0.0),
        inner_axis: tuple[float, float, float] = (0.0, 0.0, 1.0),
        sample_rate: float = 200.0,
        output: Literal["increment", "rate"] = "increment",
        outer_lever: Literal["estimated", "fixed"] = "estimated",
        mount: tuple[float, float] = (0.0, np.deg2rad(1.0)),
        azimuth_error: float = np.deg2rad(0.1),
        base_tilt: float = np.deg2rad(0.1),
        non_orthogonality: float = 60.0 * ARCSECOND,
        wobble: float = 1.0 * ARCSECOND,
        encoder_sigma: float = np.deg2rad(0.05),
        encoder_periodic: float = np.deg2rad(0.005),
        encoder_noise: float = np.deg2rad(0.0005),
        velocity_sigma: float = 1e-3,
        instability: bool = True,
        out_of_limits: bool = False,
    ) -> "BenchTruth":
        """Draw a bench; equal arguments give equal benches.

        Parameters
        ----------
        latitude, height : rad, m; gravity : m/s², None for the normal gravity
        azimuth : azimuth in the station file, rad
        sample_rate : Hz; output, outer_lever, instability, out_of_limits : see `grades.draw_imu`
        mount : smallest and largest angle of the unit on its platform, rad, uniform, about a random direction
        azimuth_error : sigma of the true azimuth about that of the file, rad
        base_tilt : size of the base's tilt about a random horizontal direction, rad
        non_orthogonality : size of the error of the right angle between the axes, either sign, rad
        wobble : tilt of each bearing, its direction random, rad
        encoder_sigma, encoder_periodic, encoder_noise : see `EncoderTruth`, rad
        velocity_sigma : rms velocity of the centre of rotation along each axis, m/s; 0 for none
        """
        unit_seed, table_seed = np.random.SeedSequence(seed).spawn(2)
        imu = draw_imu(
            grade,
            np.random.default_rng(unit_seed),
            sample_rate=sample_rate,
            output=output,
            outer_lever=outer_lever,
            instability=instability,
            out_of_limits=out_of_limits,
        )
        random = np.random.default_rng(table_seed)
        direction = random.standard_normal(3)
        turn = direction / np.linalg.norm(direction) * random.uniform(*mount)
        heading = random.uniform(0.0, 2.0 * np.pi)
        phases = random.uniform(0.0, 2.0 * np.pi, 4)
        table = TableTruth(
            latitude=latitude,
            height=height,
            azimuth=azimuth + azimuth_error * float(random.standard_normal()),
            base_tilt=(base_tilt * float(np.cos(heading)), base_tilt * float(np.sin(heading)), 0.0),
            outer_axis=outer_axis,
            inner_axis=inner_axis,
            non_orthogonality=non_orthogonality * float(random.choice([-1.0, 1.0])),
            wobble=(wobble, wobble),
            wobble_phase=(float(phases[0]), float(phases[1])),
            mount=(float(turn[0]), float(turn[1]), float(turn[2])),
            velocity_sigma=velocity_sigma,
            gravity=gravity,
        )
        encoder = EncoderTruth(encoder_sigma, encoder_periodic, (float(phases[2]), float(phases[3])), encoder_noise)
        return cls(imu, table, encoder, grade, azimuth, outer_lever)
