"""The true state of the bench: motion, errors, noise and samples of units and tables.

It is independent of the estimators, and of links and protocols.
"""

from calstation.bench.truth.base_motion import TableMotion
from calstation.bench.truth.body import BodyMotion, BodyStream, draw_mounting
from calstation.bench.truth.drive import EncoderTruth, TableDrive
from calstation.bench.truth.effects import Effects
from calstation.bench.truth.free_unit import Field, Mounting, SecondaryTruth, pair_truth, record_pair
from calstation.bench.truth.gimbal import GimbalBench, GimbalSamples, GimbalStream
from calstation.bench.truth.grades import GRADES, GradeName, draw_imu, draw_power_ups
from calstation.bench.truth.imu import ImuTruth, SensorStream, StreamOutput
from calstation.bench.truth.manual_rig import ManualRig, ManualRigStream, around, push, record
from calstation.bench.truth.noise import INSTABILITY_TIMES, instability_variance
from calstation.bench.truth.simulate import BenchTruth, Samples, Simulated, Simulator
from calstation.bench.truth.table import TableTruth, earth_rate_n, normal_gravity, rotation, unit_axes
from calstation.bench.truth.thermal import GRID, ChamberAir, ThermalSettings, UnitThermal
