"""Registers of units: transfer, journal, interrupted transfers and verification.

The register maps of the drivers are in `devices`.
"""

from calstation.registers import journal
from calstation.registers.interrupted import (
    DECISIONS,
    UnverifiedTransfer,
    open_transfer,
    recover_interrupted,
    registers_changed,
)
from calstation.registers.journal import Purpose, Transfer, journal_folder
from calstation.registers.operation import moves_table, run_operation
from calstation.registers.preconditions import check_flash, check_interrupted
from calstation.registers.run_registers import RunRegisters, run_registers, unit_transfer
from calstation.registers.unit_registers import (
    Register,
    TargetRegisters,
    UnitRegisters,
    ranges_of,
    read_unit,
    target_registers,
)
from calstation.registers.verification import (
    AppliedRegisters,
    close_checked,
    verified_on,
    verify_output,
    without_register,
)
