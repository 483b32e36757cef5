"""The stream of a unit, which is requested again if the unit restarts."""

from collections.abc import Callable

from calstation.devices import ImuIdentity, NoFramesError, OtherModelError
from calstation.devices.links import PortLostError
from calstation.errors import DeviceFaultError
from calstation.sequencer.context import RunInBackground
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.units import NO_DATA, Unit

#: Maximum station time from the command to stream to the first sample, s.
_DATA_TIMEOUT = 20.0

_READY_TIMEOUT = 60.0
_ATTEMPTS = 3


class UnitStream:
    """The stream of a unit, which is raw or corrected by its registers.

    A unit that restarts sends no data for some time, or until it is commanded to stream. Its counter restarts, it is
    not ready yet, and it outputs raw samples regardless of earlier requests. Therefore, whenever a unit was silent or a
    corrected stream was interrupted, the identity of the unit is checked and the stream is requested again.

    `check_cancelled` raises StopRequested in the background thread if its result is no longer needed.
    """

    def __init__(
        self,
        control_loop: ControlLoop,
        unit: Unit,
        run_in_background: RunInBackground,
        check_cancelled: Callable[[], None],
    ) -> None:
        self._unit = unit
        self._slot = unit.slot
        self._clock = control_loop.context.clock
        self._control_loop = control_loop
        self._acquisition = unit.acquisition
        self._run_in_background = run_in_background
        self._check_cancelled = check_cancelled
        self._corrected = False
        self._breaks = self._restarts = 0

    def start(self, *, corrected: bool) -> None:
        """Request raw or corrected output, and wait until the unit is ready and streams it. Raises DeviceFaultError."""
        self._corrected = corrected
        self._request()
        if not self._is_streaming(requested=True):
            self.restore()

    @property
    def broken(self) -> bool:
        """Whether the unit is silent, or has lost samples or readiness since `start` or `restore`."""
        return self._unit.silent or self._acquisition.breaks != self._breaks

    def restore(self) -> bool:
        """Restore the requested stream, wait until the unit is ready, and return whether it had restarted.

        Raises DeviceFaultError if this fails, and StopRequested.
        """
        restarted = False
        for _ in range(_ATTEMPTS):
            self._control_loop.tick()
            silent = self._unit.silent
            restarted |= silent or self._acquisition.restarts != self._restarts
            if silent or self._corrected:
                self._request()
            if self._is_streaming(requested=silent or self._corrected):
                return restarted
        raise DeviceFaultError("stream.restarts")

    def _request(self) -> None:
        corrected, silent = self._corrected, self._unit.silent

        def wake() -> ImuIdentity | None:
            try:
                return self._slot.imu.wake(self._check_cancelled, corrected=corrected)
            except (PortLostError, OtherModelError, NoFramesError):
                raise
            except DeviceFaultError as error:
                if not silent:
                    raise
                raise DeviceFaultError("stream.no_answer") from error

        identity = self._run_in_background(wake)
        if identity is not None:
            check_unit(identity, self._slot.unit.serial)

    def _is_streaming(self, *, requested: bool) -> bool:
        """Wait until the unit is ready, and return whether its samples arrived without interruption."""
        if not self._first_sample(requested):
            return False
        self._breaks, self._restarts = self._acquisition.breaks, self._acquisition.restarts
        self._control_loop.wait(
            lambda: self._unit.flow.ready or self.broken,
            _READY_TIMEOUT,
            DeviceFaultError("stream.not_ready", seconds=_READY_TIMEOUT),
        )
        return not self.broken

    def _first_sample(self, requested: bool) -> bool:
        """Wait for a sample, and return False if a unit that was not commanded to stream has stopped sending."""
        deadline = self._clock.now() + (_DATA_TIMEOUT if requested else NO_DATA)
        tolerates_noise, self._unit.tolerates_noise = self._unit.tolerates_noise, not requested
        try:
            while True:
                self._control_loop.tick()
                if self._unit.flow.count:
                    return True
                if self._clock.now() > deadline:
                    break
        finally:
            self._unit.tolerates_noise = tolerates_noise
        if requested:
            raise DeviceFaultError("stream.not_started")
        return False


def check_unit(identity: ImuIdentity, serial: str) -> None:
    """Check that the connected unit has the expected serial number. Raises DeviceFaultError."""
    if identity.serial != serial:
        raise DeviceFaultError("preflight.other_unit", found=identity.serial, serial=serial)
