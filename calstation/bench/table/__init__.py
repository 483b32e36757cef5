"""The simulated controller of a table: drives, limits, watchdog, register maps and text protocols.

The motion of the joints is simulated by the package `bench.truth`.
"""

from calstation.bench.table.axes import Axes
from calstation.bench.table.cia402_drives import Drive, drives
from calstation.bench.table.gimbal import GimbalController, GimbalDrive
from calstation.bench.table.machine import (
    Clocks,
    Fault,
    NoSuchRegister,
    OutOfRange,
    Power,
    Refusal,
    TableLimits,
    TableMachine,
)
from calstation.bench.table.registers import RegisterBank, TableRegisters
from calstation.bench.table.text import LANGUAGES, TextController
