"""What IMU drivers with calibration registers share: the map, entry after entry, and a restart that is waited for."""

import time
from abc import abstractmethod
from collections.abc import Mapping

from calstation.devices.frames import ReplyKind
from calstation.devices.imu_profile import CommandSection, ImuProfile
from calstation.devices.interfaces import ImuIdentity, OtherModelError
from calstation.devices.link import SerialLink
from calstation.devices.register_profile import RegisterEntry
from calstation.devices.registers import RegisterMap
from calstation.devices.streamed_imu import StreamedImu
from calstation.errors import DeviceFaultError


class RegisteredImu(StreamedImu):
    """An IMU whose link carries commands to its registers.

    Parameters
    ----------
    link : open port
    profile : what the bytes mean
    replies : packets that answer commands
    reset_timeout : host time for the unit to answer again after a reset, s
    """

    def __init__(
        self,
        link: SerialLink,
        profile: ImuProfile,
        replies: CommandSection | ReplyKind,
        reset_timeout: float,
    ) -> None:
        super().__init__(link, profile, replies)
        self._registers = RegisterMap(tuple(profile.registers))
        self._reset_timeout = reset_timeout
        self._streaming = False

    def start(self, *, corrected: bool = False) -> None:
        """Switch the stream on, see `interfaces.Imu`."""
        self._switch_on(corrected=corrected)
        self._streaming = True
        section = self._profile.corrected
        own = section.frame if section is not None and corrected else None
        self._expect(own or self._profile.frame)

    def identify(self) -> ImuIdentity:
        """Model, serial number and firmware; raises OtherModelError where another model answers."""
        identity = self._ask_identity()
        if self._profile.model not in identity.model:
            raise OtherModelError(
                f"IMU: model '{identity.model}' answers, the profile is for '{self._profile.model}';"
                " choose the right IMU profile in the product file",
                identity.model,
                self._profile.model,
            )
        return identity

    def read_registers(self) -> dict[str, float]:
        """Calibration registers in SI by parameter."""
        return self._registers.decode({e.key: self._read_entry(e) for e in self._registers.entries})

    def write_registers(self, values: Mapping[str, float]) -> None:
        """Write calibration registers; parameters not named keep theirs."""
        missing = [name for name in self._registers.parameters if name not in values]
        present = self.read_registers() if missing else {}
        numbers = self._registers.encode({**present, **values})
        for entry in self._registers.entries:
            self._write_entry(entry, numbers[entry.key])

    def reset(self) -> None:
        """Restart the unit and wait until it answers again; a stream that was on is switched on again."""
        self._restart()
        deadline = time.monotonic() + self._reset_timeout
        while True:
            try:
                self._ask_identity(attempts=1)
                break
            except DeviceFaultError:
                if self.lost or time.monotonic() > deadline:
                    raise
        if self._streaming:
            self.start()

    @abstractmethod
    def _switch_on(self, *, corrected: bool) -> None:
        """Tell the unit to stream."""

    @abstractmethod
    def _ask_identity(self, attempts: int = 3) -> ImuIdentity:
        """Who answers."""

    @abstractmethod
    def _read_entry(self, entry: RegisterEntry) -> list[float]:
        """Numbers in an entry's registers."""

    @abstractmethod
    def _write_entry(self, entry: RegisterEntry, numbers: list[float]) -> None:
        """Write numbers to an entry's registers."""

    @abstractmethod
    def _restart(self) -> None:
        """Tell the unit to restart, once."""
