"""Driver of the axes of an inertial system with its own indexing unit, commanded over the link of its data stream.

The IMU's driver owns the port; the table's registers are read and written by two of its commands.
"""

from calstation.devices.imu import FramedImu, ImuBusyError, ImuRefusalError, StreamedImu
from calstation.devices.profiles import TableProfile
from calstation.devices.table.register_table import RegisterTable
from calstation.errors import ConfigurationError, DeviceFaultError


class ImuWords:
    """A `register_table.RegisterLink` over commands of the IMU. Raises DeviceFaultError if it refuses or is silent."""

    received = b""

    def __init__(self, imu: FramedImu, *, owned: bool) -> None:
        self._imu, self._owned = imu, owned

    def read(self, address: int, count: int) -> list[int]:
        try:
            return self._imu.read_words(address, count)
        except ImuRefusalError as exc:
            code = "table.system_read_busy" if isinstance(exc, ImuBusyError) else "table.system_read_refused"
            raise DeviceFaultError(code, address=address, last=address + count - 1, reason=exc.reason) from exc

    def write(self, address: int, values: list[int], repeat: bool = True) -> None:
        try:
            self._imu.write_words(address, values, repeat)
        except ImuRefusalError as exc:
            code = "table.system_write_busy" if isinstance(exc, ImuBusyError) else "table.system_write_refused"
            raise DeviceFaultError(code, address=address, reason=exc.reason) from exc

    def close(self) -> None:
        if self._owned:
            self._imu.close()


class SharedTable(RegisterTable):
    """Driver of the axes on their IMU's link; raises ConfigurationError if the IMU lacks the commands for them."""

    def __init__(self, imu: StreamedImu, profile: TableProfile, *, owned: bool = False) -> None:
        if not isinstance(imu, FramedImu):
            if owned:
                imu.close()
            raise ConfigurationError("table.imu_without_words", profile=profile.name)
        super().__init__(ImuWords(imu, owned=owned), profile)
