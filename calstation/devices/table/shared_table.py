"""The axes of an inertial system with its own indexing unit, commanded through the link that carries its data.

The system's port has one owner, the IMU's driver; the table's registers are read and written by two commands of it.
"""

from calstation.devices.imu.framed_imu import FramedImu
from calstation.devices.imu.streamed_imu import ImuBusyError, ImuRefusalError, StreamedImu
from calstation.devices.profiles.table import TableProfile
from calstation.devices.table.register_table import RegisterTable
from calstation.errors import ConfigurationError, DeviceFaultError


class ImuWords:
    """Registers of the axes behind an IMU's commands; meets `register_table.RegisterLink`.

    Parameters
    ----------
    imu : owner of the port; owned : closed with the axes
    """

    heard = b""

    def __init__(self, imu: FramedImu, *, owned: bool) -> None:
        self._imu, self._owned = imu, owned

    def read(self, address: int, count: int) -> list[int]:
        """Read registers; a lost transfer is repeated. Raises DeviceFaultError."""
        try:
            return self._imu.read_words(address, count)
        except ImuRefusalError as exc:
            what = f"registers {address}-{address + count - 1} cannot be read"
            raise _explained(what, exc) from exc

    def write(self, address: int, values: list[int], repeat: bool = True) -> None:
        """Write registers; a lost transfer is repeated only where `repeat`. Raises DeviceFaultError."""
        try:
            self._imu.write_words(address, values, repeat)
        except ImuRefusalError as exc:
            raise _explained(f"register {address} cannot be written", exc) from exc

    def close(self) -> None:
        """Hang up, where nobody else has the port."""
        if self._owned:
            self._imu.close()


def _explained(what: str, refusal: ImuRefusalError) -> DeviceFaultError:
    """The system's refusal as one of its axes."""
    busy = isinstance(refusal, ImuBusyError)
    mend = "wait until it is done, then start again" if busy else "check the table profile's registers"
    return DeviceFaultError(f"table: {what}: {refusal.reason}; {mend}")


class SharedTable(RegisterTable):
    """The axes of a profile behind the link of the IMU that they belong to.

    Parameters
    ----------
    imu : owner of the port
    profile : what the registers mean
    owned : close the IMU with the table: nobody else uses it

    Raises
    ------
    ConfigurationError
        where that IMU's commands cannot carry registers.
    """

    def __init__(self, imu: StreamedImu, profile: TableProfile, *, owned: bool = False) -> None:
        if not isinstance(imu, FramedImu):
            if owned:
                imu.close()
            raise ConfigurationError(
                f"table: profile '{profile.name}' is of axes behind the IMU's link, but the product's IMU profile has"
                " no framed commands; choose the profiles that belong together"
            )
        section = profile.imu_link
        assert section is not None
        super().__init__(ImuWords(imu, owned=owned), profile, section.gap)
