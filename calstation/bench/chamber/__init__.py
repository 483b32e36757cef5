"""The simulated controller of a chamber, its faults, and its protocols: Simserv, and the registers of a Watlow F4.

The temperatures are simulated by the package `bench.truth`.
"""

from calstation.bench.chamber.machine import ChamberMachine, ChamberSettings
from calstation.bench.chamber.registers import ChamberRegisters
from calstation.bench.chamber.simserv import Simserv
