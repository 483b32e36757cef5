"""Message ids, states, stages, groups and steps as sentences in the language in force; the engine knows none."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QCoreApplication

from calstation.gui.text.fault_wording import translated
from calstation.messages.marked import QT_TRANSLATE_NOOP

_CONTEXT = "wording"


_STAGES = {
    "rate": QT_TRANSLATE_NOOP("wording", "Rate"),
    "six_position": QT_TRANSLATE_NOOP("wording", "Six positions"),
    "excitation": QT_TRANSLATE_NOOP("wording", "Excitation"),
    "azimuth_flip": QT_TRANSLATE_NOOP("wording", "Azimuth flips"),
    "multi_position": QT_TRANSLATE_NOOP("wording", "Multi-position"),
    "gimbal": QT_TRANSLATE_NOOP("wording", "Gimbal"),
    "cross_calibration": QT_TRANSLATE_NOOP("wording", "Cross-calibration"),
    "transfer": QT_TRANSLATE_NOOP("wording", "Transfer"),
}

_GROUPS = {
    "gyro_bias": QT_TRANSLATE_NOOP("wording", "gyro bias"),
    "gyro_scale": QT_TRANSLATE_NOOP("wording", "gyro scale factor"),
    "gyro_misalign": QT_TRANSLATE_NOOP("wording", "gyro misalignment"),
    "accel_bias": QT_TRANSLATE_NOOP("wording", "accel bias"),
    "accel_scale": QT_TRANSLATE_NOOP("wording", "accel scale factor"),
    "accel_misalign": QT_TRANSLATE_NOOP("wording", "accel misalignment"),
    "accel_quadratic": QT_TRANSLATE_NOOP("wording", "accel quadratic"),
    "inner_lever": QT_TRANSLATE_NOOP("wording", "inner lever arm"),
    "outer_lever": QT_TRANSLATE_NOOP("wording", "outer lever arm"),
}

_MESSAGES = {
    "identified": QT_TRANSLATE_NOOP("wording", "Table {table} ({table_serial}), IMU {imu} {serial}."),
    "incomplete_run": QT_TRANSLATE_NOOP(
        "wording", "An earlier run did not reach its end: {log} (its samples can be solved again)."
    ),
    "waiting_ready": QT_TRANSLATE_NOOP("wording", "Waiting for the unit to be ready."),
    "homing": QT_TRANSLATE_NOOP("wording", "Homing the table, slowly."),
    "warming_up": QT_TRANSLATE_NOOP("wording", "Warming up, {seconds:g} s at least."),
    "checking_mounting": QT_TRANSLATE_NOOP("wording", "Checking gravity, signs and data flow."),
    "checking_gravity": QT_TRANSLATE_NOOP("wording", "Checking gravity's length and data flow."),
    "step_repeated": QT_TRANSLATE_NOOP("wording", "Step repeated ({reason}), attempt {attempt}."),
    "finishing": QT_TRANSLATE_NOOP("wording", "To the load angle, axes off."),
    "safe_stop_incomplete": QT_TRANSLATE_NOOP("wording", "Safe stop: {text}"),
    "azimuth_from_data": QT_TRANSLATE_NOOP(
        "wording", "{stage}: azimuth found from the data, not from the station file."
    ),
    "not_settled": QT_TRANSLATE_NOOP(
        "wording", "{stage}: {passes} passes did not settle the answer; take its sigmas with care."
    ),
    "turns_assumed_whole": QT_TRANSLATE_NOOP(
        "wording", "{stage}: no encoder angles; every turn is taken for whole."
    ),
    "recording_cut": QT_TRANSLATE_NOOP(
        "wording", "{stage}: force jumps at rest in {count} places; nothing is taken from the motions there."
    ),
    "motions_left_out": QT_TRANSLATE_NOOP(
        "wording", "{stage}: in {count} motions the gyros contradict gravity; they are left out."
    ),
    "no_motion_between_rests": QT_TRANSLATE_NOOP(
        "wording", "{stage}: no motion between rests was recorded; gyro matrices are not determined."
    ),
    "noisier_than_profile": QT_TRANSLATE_NOOP(
        "wording",
        "{stage}: the recording scatters more than the profile's noise (rests {force:.2g} m/s² "
        "and {rate:.2g} rad/s, turns {turn:.2g} rad); the sigmas count it.",
    ),
    "pair_primary_off": QT_TRANSLATE_NOOP(
        "wording",
        "{stage}: at {time:.0f} s the primary is off itself; imu{number} is not calibrated against it.",
    ),
    "pair_calibrated": QT_TRANSLATE_NOOP(
        "wording", "{stage}: at {time:.0f} s imu{number} was off and has been calibrated."
    ),
    "pair_given_up": QT_TRANSLATE_NOOP(
        "wording", "{stage}: at {time:.0f} s calibration was given up: {why}."
    ),
    "pair_kept": QT_TRANSLATE_NOOP(
        "wording", "{stage}: nothing new for secondary {numbers}; what was stored stays."
    ),
    "gimbal_unstable": QT_TRANSLATE_NOOP(
        "wording",
        "{stage}: a gain of {gain:g} is beyond the {limit:.2f} up to which turns about {axis} converge.",
    ),
    "gimbal_axes_missing": QT_TRANSLATE_NOOP(
        "wording",
        "{stage}: no turns about {axes}; misalignments of those columns are not determined.",
    ),
    "registers_transfer": QT_TRANSLATE_NOOP("wording", "Inside the limits: writing the registers."),
    "transfer_unproved": QT_TRANSLATE_NOOP(
        "wording",
        "The registers are written but not verified: the next start with this unit asks whether to finish or to put"
        " the old ones back.",
    ),
    "transfer_finished": QT_TRANSLATE_NOOP(
        "wording", "The stop came while the registers were written: the transfer was finished first."
    ),
    "transfer_kept": QT_TRANSLATE_NOOP(
        "wording", "An earlier transfer to {serial} was interrupted; the unit kept its registers."
    ),
    "transfer_open": QT_TRANSLATE_NOOP(
        "wording", "An earlier transfer to {serial} was interrupted ({utc}); the unit holds {holds}."
    ),
    "transfer_settled": QT_TRANSLATE_NOOP(
        "wording", "The interrupted transfer to {serial} is settled: {closing}."
    ),
    "journal_torn": QT_TRANSLATE_NOOP(
        "wording", "A power cut tore the last line of {file}; it announces nothing that happened."
    ),
    "flash_near": QT_TRANSLATE_NOOP(
        "wording",
        "The flash of {serial} has been written {used} times of the {most} that its profile allows.",
    ),
    "log_damaged": QT_TRANSLATE_NOOP(
        "wording",
        "Damaged rows of the log left out as gaps: {rows}, samples {where}.",
    ),
    "resumed": QT_TRANSLATE_NOOP("wording", "Carrying on {log} after its finished stages: {stages}."),
    "handover_waiting": QT_TRANSLATE_NOOP(
        "wording", "Hand-over: {count} waiting, {folder} cannot be reached ({reason})."
    ),
    "handover_done": QT_TRANSLATE_NOOP("wording", "Hand-over: {count} results went to {folder}."),
    "registers_writing": QT_TRANSLATE_NOOP("wording", "Writing the registers."),
    "registers_proved": QT_TRANSLATE_NOOP(
        "wording", "Registers written, read back, and the output right with them ({proof})."
    ),
    "old_unproved": QT_TRANSLATE_NOOP(
        "wording", "The old registers are back as they were; the output was not looked at to its end."
    ),
    "verifying": QT_TRANSLATE_NOOP("wording", "Checking the output of the restarted unit."),
    "look_repeated": QT_TRANSLATE_NOOP(
        "wording", "The unit restarted by itself: its output is looked at again from the beginning."
    ),
    "registers_kept": QT_TRANSLATE_NOOP("wording", "Outside the limits: the unit keeps its registers."),
    "better_kept": QT_TRANSLATE_NOOP(
        "wording", "{parameter} kept: {before} from {date} is better than {now} now."
    ),
    "better_changed": QT_TRANSLATE_NOOP(
        "wording", "{parameter} replaced: it is now ({now}) far from what was found on {date} ({before})."
    ),
    "registers_written": QT_TRANSLATE_NOOP(
        "wording", "Registers written, read back, and the output right with them."
    ),
    "registers_read_back": QT_TRANSLATE_NOOP(
        "wording",
        "Registers written and read back; what the unit makes of them cannot be seen: it shows no corrected output.",
    ),
    "reference": QT_TRANSLATE_NOOP("wording", "Looking at the unit before its registers are written."),
    "stopped_early": QT_TRANSLATE_NOOP(
        "wording", "{stage} is outside the limits: the remaining stages are left out."
    ),
    "latitude_untold": QT_TRANSLATE_NOOP(
        "wording",
        "{stage} does not fit together, and no rest of this run tells the latitude that it believes: make sure of"
        " site.latitude_deg = {latitude:g} in the station file; a run with six_position tells it.",
    ),
    "stopped_because": QT_TRANSLATE_NOOP("wording", "Stopped safely: {reason}."),
}

_REASONS = {
    "gap": QT_TRANSLATE_NOOP("wording", "samples lost"),
    "no_data": QT_TRANSLATE_NOOP("wording", "no data"),
    "saturated": QT_TRANSLATE_NOOP("wording", "output saturated"),
    "invalid": QT_TRANSLATE_NOOP("wording", "output is no number"),
    "signal": QT_TRANSLATE_NOOP("wording", "the computer asked the program to end"),
    "listener_lost": QT_TRANSLATE_NOOP("wording", "the window or terminal that watched the run is gone"),
    "listener_silent": QT_TRANSLATE_NOOP(
        "wording", "the window or terminal that watched the run does not answer"
    ),
}

#: Values of messages that are words themselves.
_VALUES = {
    "holds": {
        "old": QT_TRANSLATE_NOOP("wording", "its old registers"),
        "new": QT_TRANSLATE_NOOP("wording", "its new registers"),
        "neither": QT_TRANSLATE_NOOP("wording", "neither its old nor its new registers"),
    },
    "closing": {
        "done": QT_TRANSLATE_NOOP("wording", "the new registers are written"),
        "kept": QT_TRANSLATE_NOOP("wording", "the unit kept its registers"),
        "restored": QT_TRANSLATE_NOOP("wording", "the old registers are back"),
    },
    "reason": _REASONS,
    "proof": {
        "turn": QT_TRANSLATE_NOOP("wording", "with a turn of the table"),
        "rest": QT_TRANSLATE_NOOP("wording", "at rest, no turn was made"),
        "read_back": QT_TRANSLATE_NOOP("wording", "by reading back alone"),
    },
}

#: A run's states and outcomes as they stand on the screen.
_STATES = {
    "idle": QT_TRANSLATE_NOOP("wording", "READY"),
    "starting": QT_TRANSLATE_NOOP("wording", "STARTING"),
    "preparing": QT_TRANSLATE_NOOP("wording", "PREPARING"),
    "running": QT_TRANSLATE_NOOP("wording", "RUNNING"),
    "writing": QT_TRANSLATE_NOOP("wording", "WRITING"),
    "pausing": QT_TRANSLATE_NOOP("wording", "COMING TO REST"),
    "paused": QT_TRANSLATE_NOOP("wording", "PAUSED"),
    "stopping": QT_TRANSLATE_NOOP("wording", "STOPPING"),
    "stopped": QT_TRANSLATE_NOOP("wording", "STOPPED"),
    "fault": QT_TRANSLATE_NOOP("wording", "FAULT"),
    "passed": QT_TRANSLATE_NOOP("wording", "PASS"),
    "failed": QT_TRANSLATE_NOOP("wording", "FAIL"),
    "incomplete": QT_TRANSLATE_NOOP("wording", "INCOMPLETE"),
    "resolved": QT_TRANSLATE_NOOP("wording", "SOLVED OFFLINE"),
}

#: The shape (`widgets.badge.KINDS`) that goes with each state.
KINDS = {
    "idle": "none",
    "starting": "waiting",
    "preparing": "active",
    "running": "active",
    "writing": "active",
    "pausing": "paused",
    "paused": "paused",
    "stopping": "stopped",
    "stopped": "stopped",
    "fault": "caution",
    "passed": "good",
    "failed": "bad",
    "incomplete": "waiting",
}

_STEPS = {
    "start": QT_TRANSLATE_NOOP("wording", "To the start of the stage"),
    "into_place": QT_TRANSLATE_NOOP("wording", "Bringing axis {1} into place"),
    "whole_turns": QT_TRANSLATE_NOOP("wording", "Turning about {1} by {2:g}°"),
    "turn_about": QT_TRANSLATE_NOOP("wording", "Turning about {1} by {2:g}°"),
    "unwind": QT_TRANSLATE_NOOP("wording", "Unwinding before the next turn about {1}"),
    "face_up": QT_TRANSLATE_NOOP("wording", "Turning {1} up"),
    "flip": QT_TRANSLATE_NOOP("wording", "Half turn about the vertical, {1:+g}°"),
    "return": QT_TRANSLATE_NOOP("wording", "Back to the start of the step"),
    "check": QT_TRANSLATE_NOOP("wording", "A small turn to check mounting and signs"),
    "verify": QT_TRANSLATE_NOOP("wording", "A turn to verify what was written"),
    "load": QT_TRANSLATE_NOOP("wording", "To the load angle"),
    "position": QT_TRANSLATE_NOOP("wording", "To outer {1:g}°, inner {2:g}°"),
    "carry": QT_TRANSLATE_NOOP("wording", "Outer rail to {1:.0f}°, inner rail to {2:.0f}°, then let go"),
}


def _say(text: str) -> str:
    return QCoreApplication.translate(_CONTEXT, text)


def word_stage(stage: str) -> str:
    """A stage's name."""
    return _say(_STAGES[stage]) if stage in _STAGES else stage.replace("_", " ")


def word_group(group: str) -> str:
    """A parameter group's name."""
    return _say(_GROUPS[group]) if group in _GROUPS else group.replace("_", " ")


def word_state(state: str) -> str:
    """A state or outcome in capitals."""
    return _say(_STATES[state]) if state in _STATES else state


def word_message(key: str, values: Mapping[str, Any]) -> str:
    """The sentence of a message; an unknown id is shown with its values."""
    if key not in _MESSAGES:
        details = ", ".join(f"{name} {value}" for name, value in values.items())
        return f"{key.replace('_', ' ')}{': ' if details else ''}{details}"
    shown = dict(values)
    for name, words in _VALUES.items():
        if shown.get(name) in words:
            shown[name] = _say(words[str(shown[name])])
    if isinstance(shown.get("stages"), list | tuple):
        shown["stages"] = ", ".join(word_stage(str(stage)) for stage in shown["stages"])
    if "stage" in shown:
        shown["stage"] = word_stage(str(shown["stage"]))
    if key == "safe_stop_incomplete":
        shown["text"] = translated(str(shown["text"]))
    return _say(_MESSAGES[key]).format(**shown)


def word_busy(errand: bool) -> str:
    """Why nothing else can be begun now, and the mend."""
    if errand:
        return _say(QT_TRANSLATE_NOOP("wording", "Registers are being written; press STOP first."))
    return _say(QT_TRANSLATE_NOOP("wording", "A calibration is going on; press STOP first."))


def word_step(kind: str, label: tuple[str | float, ...]) -> str:
    """What a step does, in a few words; a dwell after a labelled move says where it rests."""
    if kind == "dwell":
        resting = _say(QT_TRANSLATE_NOOP("wording", "Resting"))
        return f"{word_step('move', label)}  ·  {resting}" if label else resting
    if not label:
        return _say(QT_TRANSLATE_NOOP("wording", "Moving"))
    template = _STEPS.get(str(label[0]))
    if template is not None:
        return _say(template).format(*label)
    return " ".join(
        f"{part:g}" if isinstance(part, float | int) else part.replace("_", " ") for part in label
    )


def word_time(seconds: float) -> str:
    """A duration as ``m:ss`` or ``h:mm:ss``."""
    minutes, rest = divmod(max(0, round(seconds)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
