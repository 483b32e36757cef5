"""Puts a calibration into the unit's registers: write, read back, compare, commit, restart, read again."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from calstation.devices.interfaces import Imu
from calstation.devices.registers import RegisterMap
from calstation.errors import DeviceFaultError


@dataclass(frozen=True)
class Transferred:
    """The unit's registers before and after, by parameter, SI; `verified` by reading the restarted unit."""

    old: dict[str, float]
    new: dict[str, float]
    verified: bool


def transfer(
    imu: Imu,
    registers: RegisterMap,
    values: Mapping[str, float],
    on_old: Callable[[Mapping[str, float]], None],
) -> Transferred:
    """Write the parameters that have registers; registers of other parameters keep their values.

    Parameters
    ----------
    values : new values by contract name, SI; names without a register are left aside
    on_old : told the unit's present registers before anything is written, so that they are kept

    Raises
    ------
    DeviceFaultError
        where a value does not fit, the link fails, or a register does not read back; says which.
    """
    old = imu.read_registers()
    on_old(old)
    wanted = registers.rounded({**old, **{k: v for k, v in values.items() if k in old}})
    imu.write_registers(wanted)
    _compare(
        registers, wanted, imu.read_registers(), "before the commit; the unit's flash keeps its old values"
    )
    imu.commit()
    imu.reset()
    found = imu.read_registers()
    _compare(registers, wanted, found, "after the restart; write the old values from the log again")
    return Transferred(old, found, True)


def _compare(
    registers: RegisterMap, wanted: Mapping[str, float], found: Mapping[str, float], when: str
) -> None:
    for name, value in wanted.items():
        if found.get(name) != value:
            raise DeviceFaultError(
                f"IMU: register {registers.address(name)} ({name}) reads back {found.get(name):.9g}"
                f" instead of {value:.9g} {when}"
            )
