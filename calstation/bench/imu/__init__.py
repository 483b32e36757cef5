"""The unit's processor: registers, flash, protocols and stream faults.

The measurements of its sensors are simulated in `bench.truth`.
"""

from calstation.bench.imu.flash import burnt_cycles
from calstation.bench.imu.stream_faults import StreamFaults
from calstation.bench.imu.unit import ImuUnit
from calstation.bench.imu.units import UNITS
