"""The processor of a simulated unit: registers, flash, protocols and stream faults; sensors are in `bench.truth`."""

from calstation.bench.imu.stream_faults import StreamFaults
from calstation.bench.imu.unit import ImuUnit, count_flash_cycles
from calstation.bench.imu.units import UNITS
