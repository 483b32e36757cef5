"""Transfers in the journal of a virtual unit that have not ended."""

from pathlib import Path

from calstation.devices.imu import TransferStep
from calstation.registers import Purpose, Transfer, journal

#: Steps of a transfer that is written, but not verified.
WRITTEN = (TransferStep.WRITTEN, TransferStep.COMMITTING, TransferStep.COMMITTED, TransferStep.RESTARTED)


#: Purpose of a transfer by a run.
RUN = Purpose("Li Na", "run", "a.h5")


def write_open_transfer(runs: Path, serial: str, *steps: TransferStep, purpose: Purpose = RUN) -> Transfer:
    """Record a transfer and its steps; by default, it was interrupted while the registers were written."""
    entry = journal.begin(runs, serial, {}, {"gyro_bias_x": 1e-6}, purpose)
    for step in steps or (TransferStep.WRITTEN, TransferStep.COMMITTING):
        entry.note(step)
    return entry
