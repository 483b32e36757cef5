"""A unit's stream, kept as it was told to be: on again, and of the same kind, where the unit restarted by itself."""

from collections.abc import Callable
from typing import Any

from calstation.devices.interfaces import Imu, ImuIdentity, NoFramesError, OtherModelError
from calstation.devices.links.serial_link import PortLostError
from calstation.errors import DeviceFaultError
from calstation.sequencer.acquisition import Acquisition
from calstation.sequencer.control_loop import NO_DATA, ControlLoop
from calstation.sequencer.ports import Clock

#: Station time for the first sample of a unit that was asked to stream, s.
_DATA_WITHIN = 20.0

_READY_WITHIN = 60.0
_ATTEMPTS = 3


class UnitStream:
    """What comes from the unit, and whether it is what was asked for.

    A unit that restarts is silent for a while, or until it is told to stream; it counts anew, is not ready yet, and
    shows its raw output whatever was asked before. So behind every interruption of what is not its raw output, and
    behind every silence, it is asked who it is and told again.

    Parameters
    ----------
    aside : does what takes its time, the table's watchdog fed meanwhile
    hear : raises in it where nobody waits for its end any more
    check : refuses another unit than the one that is meant; raises DeviceFaultError
    """

    def __init__(
        self,
        imu: Imu,
        control_loop: ControlLoop,
        acquisition: Acquisition,
        clock: Clock,
        run_in_background: Callable[[Callable[[], Any]], Any],
        check_cancelled: Callable[[], None],
        check: Callable[[ImuIdentity], None],
    ) -> None:
        self._imu = imu
        self._control_loop = control_loop
        self._acquisition = acquisition
        self._clock = clock
        self._aside = run_in_background
        self._hear = check_cancelled
        self._check = check
        self._corrected = False
        self._breaks = self._restarts = 0

    def start(self, *, corrected: bool) -> None:
        """Ask for a kind of output; return when it comes from a unit that is ready. Raises DeviceFaultError."""
        self._corrected = corrected
        self._wake()
        if not self._flows(asked=True):
            self.mend()

    @property
    def broken(self) -> bool:
        """Whether since `start` or `mend` samples were missed, or the unit was not ready, or nothing comes now."""
        return self._control_loop.silent or self._acquisition.breaks != self._breaks

    def mend(self) -> bool:
        """Have it as it was asked for, from a unit that is ready; returns whether the unit had restarted.

        Raises DeviceFaultError where it does not come to that, StopRequested.
        """
        restarted = False
        for _ in range(_ATTEMPTS):
            self._control_loop.tick()
            silent = self._control_loop.silent
            restarted |= silent or self._acquisition.restarts != self._restarts
            if silent or self._corrected:
                self._wake()
            if self._flows(asked=silent or self._corrected):
                return restarted
        raise DeviceFaultError(
            "IMU: it restarts again and again; check its supply, plug and cable, then start again"
        )

    def _wake(self) -> None:
        corrected, silent = self._corrected, self._control_loop.silent

        def wake() -> ImuIdentity | None:
            try:
                return self._imu.wake(self._hear, corrected=corrected)
            except (PortLostError, OtherModelError, NoFramesError):
                raise
            except DeviceFaultError as error:
                if not silent:
                    raise
                raise DeviceFaultError(
                    "IMU: no data any more, and the unit does not answer either; check its power, cable and port"
                ) from error

        identity = self._aside(wake)
        if identity is not None:
            self._check(identity)

    def _flows(self, *, asked: bool) -> bool:
        """Whether samples come, and none is missed between the first of them and the unit's being ready."""
        if not self._heard(asked):
            return False
        self._breaks, self._restarts = self._acquisition.breaks, self._acquisition.restarts
        self._control_loop.wait(
            lambda: self._control_loop.flow.ready or self.broken,
            _READY_WITHIN,
            f"IMU: not ready {_READY_WITHIN:g} s after its restart; switch it off and on",
        )
        return not self.broken

    def _heard(self, asked: bool) -> bool:
        """Wait for a sample; False where a unit that was not `asked` for any has fallen silent."""
        deadline = self._clock.now() + (_DATA_WITHIN if asked else NO_DATA)
        patient, self._control_loop.patient = self._control_loop.patient, not asked
        try:
            while True:
                self._control_loop.tick()
                if self._control_loop.flow.count:
                    return True
                if self._clock.now() > deadline:
                    break
        finally:
            self._control_loop.patient = patient
        if asked:
            raise DeviceFaultError(
                "IMU: no data any more though it was told to stream; switch it off and on, then check cable, power and"
                " port"
            )
        return False
