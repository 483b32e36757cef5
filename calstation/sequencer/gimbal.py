"""Control of a gimbal: return to zero, stabilised turns with the correction in the registers, and verification."""

from collections.abc import Mapping
from typing import cast

import numpy as np

from calstation.devices import Gimbal, TableStatus
from calstation.errors import CalstationError, DeviceFaultError
from calstation.estimation.gimbal import BIAS_TIME, GimbalIteration, Motion, drift_matrix, joint_turn
from calstation.physics import AXES, FloatArray, GimbalJoints, GimbalTurn, GimbalZero
from calstation.sequencer.context import RunInBackground
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.events import GimbalTurned, StepStarted
from calstation.sequencer.guard import check_joints, check_motion
from calstation.sequencer.verification_path import JointDrift

#: Largest angle of a joint that has returned to zero, rad.
_ZERO_TOLERANCE = np.deg2rad(0.5)
#: Smallest angle of a complete turn, as a fraction of the commanded angle.
_MIN_TURN_FRACTION = 0.8
#: Longest duration of a return to zero, s.
_HOME_TIMEOUT = 60.0
#: Largest accepted difference between the written and the read-back correction, rad.
_MAX_READ_BACK_ERROR = 1e-6


class GimbalLoop:
    """Executes the steps of a gimbal stage in a closed loop.

    Before every turn, the correction K is written to the volatile registers of the unit and read back. `restore`
    writes the original values. The values in flash change only in the transfer at the end of a run.
    """

    def __init__(self, control_loop: ControlLoop, run_in_background: RunInBackground = lambda work: work()) -> None:
        self._control_loop = control_loop
        self._context = control_loop.context
        self._run_in_background = run_in_background
        self._original_values: Mapping[str, float] | None = None
        self.begin()

    def begin(self) -> None:
        """Begin a stage with K = 0."""
        self._iteration: GimbalIteration | None = None
        self._ready = self._zeroed = False

    def home(self) -> None:
        """Return all joints to zero and lock them. Raises DeviceFaultError."""
        loop = self._control_loop
        check_motion(loop.status)
        self._ready = self._zeroed = False
        self._gimbal.home()
        loop.tick()
        loop.wait(lambda: self._at_zero(loop.status), _HOME_TIMEOUT, DeviceFaultError("motion.zero_not_reached"))

    def zero(self, step: GimbalZero) -> None:
        """Return to zero and measure the gyro bias; the joints stay locked until the next turn."""
        self._begin_step("gimbal_zero", (float(step.index),))
        self._zero(step.rest)

    def turn(self, step: GimbalTurn) -> None:
        """Execute the next turn, and correct K by the measured drift; do nothing if the axis is complete."""
        iteration = self._iteration = self._iteration or _iteration(step, self._joints)
        if iteration.axis_done and iteration.courses[-1].axis == step.axis:
            return
        command = iteration.next_turn()
        if command is None:
            raise RuntimeError("a turn after the last axis")
        if not self._ready or (command.home and not self._zeroed):
            self._zero(step.rest + BIAS_TIME)
        self._ready = False  # after an interruption, the joints are locked and the turn is repeated from zero
        self._begin_step("gimbal_turn", (AXES[step.axis], float(step.index), float(step.count)))
        self._write(command.correction)
        motion = self._measured_turn(step.axis, command.angle, step)
        drift = motion.joint_drift(step.axis, self._joints.order)
        iteration.add_drift(step.axis, command.angle, drift)
        self._context.emit(
            GimbalTurned(
                step.axis,
                len(iteration.courses[-1].drifts),
                command.angle,
                tuple(float(v) for v in drift),
                step.threshold,
                step.gain,
                iteration.axis_done,
            )
        )

    def verification_turns(self) -> tuple[JointDrift, ...]:
        """Turn once about every axis with the registers of the unit, and return the drifts. Raises DeviceFaultError."""
        step = cast(GimbalTurn, self._context.task.gimbal_turn)
        drifts = []
        for axis in range(3):
            self._zero(step.rest + BIAS_TIME)
            motion = self._measured_turn(axis, step.angle, step)
            order = self._joints.order
            J = drift_matrix(order, axis, motion.angle)
            drifts.append(JointDrift(axis, J, motion.joint_drift(axis, order), motion.duration, motion.rest))
        self.home()
        return tuple(drifts)

    def restore(self) -> None:
        """Write the original misalignments of the unit if K has replaced them. Raises DeviceFaultError."""
        original, self._original_values = self._original_values, None
        if original is not None:
            self._run_in_background(lambda: self._context.slot.imu.write_registers(original))

    @property
    def _gimbal(self) -> Gimbal:
        return cast(Gimbal, self._context.table)

    @property
    def _joints(self) -> GimbalJoints:
        return cast(GimbalJoints, self._context.task.geometry.gimbal)

    def _begin_step(self, kind: str, label: tuple[str | float, ...]) -> None:
        tags = self._control_loop.tags
        tags.step += 1
        self._context.emit(StepStarted(tags.stage, tags.step, kind, (kind, *label)))

    def _zero(self, seconds: float) -> None:
        self.home()
        self._gimbal.lock()
        self._control_loop.rest(seconds)
        if self._iteration is not None:
            self._iteration.at_zero()
        self._ready = self._zeroed = True

    def _measured_turn(self, axis: int, angle: float, step: GimbalTurn) -> Motion:
        """Rest, turn by `angle`, rad, and rest again; return the motion of the joints."""
        loop, model = self._control_loop, self._context.slot.unit.model
        if self._zeroed:
            self._gimbal.stabilise()
        with loop.units.first.acquisition.tap() as blocks:
            loop.rest(step.rest)
            start = self._joint(axis)
            self._check_turn(axis, start + angle)
            self._zeroed = False
            begin = int(blocks[-1].seq[-1])
            self._gimbal.turn(axis, angle, step.rate)
            loop.tick()
            loop.wait(
                lambda: _is_at_rest(loop.status) and abs(self._joint(axis) - start) > _MIN_TURN_FRACTION * abs(angle),
                3.0 * abs(angle) / step.rate + 10.0,
                lambda: DeviceFaultError(
                    "motion.turn_not_made",
                    axis=AXES[axis],
                    wanted_deg=float(np.rad2deg(angle)),
                    turned_deg=float(np.rad2deg(self._joint(axis) - start)),
                ),
            )
            loop.rest(step.rest)

            try:
                motion: Motion = self._run_in_background(lambda: joint_turn(blocks, model, begin, axis))
            except CalstationError as error:
                raise DeviceFaultError("motion.turn_unusable", axis=AXES[axis], reason=error.as_text) from error
        self._ready = True
        return motion

    def _check_turn(self, axis: int, target: float) -> None:
        """Check power, watchdog and travel before a turn to joint angle `target`, rad. Raises DeviceFaultError."""
        check_motion(self._control_loop.status)
        joints = self._measured().copy()
        joints[axis] = target
        check_joints(self._joints, joints)

    def _joint(self, axis: int) -> float:
        return float(self._measured()[axis])

    def _measured(self) -> FloatArray:
        return cast(FloatArray, self._control_loop.status.joints)

    def _at_zero(self, status: TableStatus) -> bool:
        joints = status.joints
        return (
            status.homed
            and _is_at_rest(status)
            and joints is not None
            and float(np.abs(joints).max()) < _ZERO_TOLERANCE
        )

    def _write(self, correction: FloatArray) -> None:
        """Write K, shape (3, 3), without the scale factors of the registers, and read it back."""
        imu = self._context.slot.imu

        def write() -> float:
            before = imu.read_registers()
            names = [f"gyro_misalign_{a}{b}" for a in AXES for b in AXES if a != b]
            if self._original_values is None:
                self._original_values = {name: before[name] for name in names}
            target = {
                name: float(correction[AXES.index(name[-2]), AXES.index(name[-1])])
                * (1.0 + before.get(f"gyro_scale_{name[-1]}", 0.0))
                for name in names
            }
            imu.write_registers(target)
            read = imu.read_registers()
            return max(abs(read[name] - target[name]) for name in names)

        self._control_loop.pausable = self._control_loop.watchful = False
        difference = self._run_in_background(write)
        self._control_loop.tick()
        self._control_loop.pausable = self._control_loop.watchful = True
        if difference > _MAX_READ_BACK_ERROR:
            raise DeviceFaultError("motion.correction_not_kept", difference_arcsec=float(np.rad2deg(difference)) * 3600)


def _iteration(step: GimbalTurn, joints: GimbalJoints) -> GimbalIteration:
    travel = min(min(-low, high) for low, high in joints.travel)
    return GimbalIteration(
        step.gain, step.angle, step.count, step.threshold, step.alternate, min(travel, GimbalIteration.travel)
    )


def _is_at_rest(status: TableStatus) -> bool:
    return status.settled and not status.moving
