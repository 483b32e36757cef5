"""What a unit's flash has left: said in time, and no new registers for one that is worn out.

Putting old registers back, and finishing what was begun, is never refused: a unit must not be left half written.
"""

from pathlib import Path

from calstation.config.resolved import ResolvedConfiguration
from calstation.errors import ConfigurationError
from calstation.registers import journal as register_journal
from calstation.registers.journal import site_of
from calstation.sequencer.events import Message
from calstation.sequencer.ports import Emit

#: Share of the cycles from which on it is told.
_NEAR = 0.9


def check_flash(setup: ResolvedConfiguration, runs: Path, emit: Emit) -> None:
    """Before new registers, and before anything is opened: may the unit's flash be written once more?

    Raises ConfigurationError where its profile's `flash_cycles_max` is reached, or its journal is damaged.
    """
    serial = setup.request.serial
    site = site_of(setup.station)
    used = register_journal.cycles(runs, serial, site)
    torn = register_journal.torn(runs, serial, site)
    if torn is not None:
        emit(Message("journal_torn", {"serial": serial, "file": str(torn)}))
    most = setup.imu.flash_cycles_max
    if most is None or not setup.imu.registers:
        return
    if used >= most:
        raise ConfigurationError(
            f"IMU: unit '{serial}' has had its flash written {used} times of the {most} that IMU profile"
            f" '{setup.imu.name}' allows (flash_cycles_max); take it out of service, or correct the profile where its"
            " data sheet allows more"
        )
    if used >= _NEAR * most:
        emit(Message("flash_near", {"serial": serial, "used": used, "most": most}))
