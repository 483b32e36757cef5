"""The English sentence for every message id of events and solutions; the engine itself knows no sentences."""

from collections.abc import Mapping
from math import degrees
from typing import Any

from calstation.sequencer.events import PositionGuided

#: Sentence by message id, with the values' names in braces.
MESSAGES: dict[str, str] = {
    "identified": "Table {table} ({table_serial}), IMU {imu} {serial}.",
    "incomplete_run": "An earlier run did not reach its end: {log} (its samples can be resolved).",
    "waiting_ready": "Waiting for the unit to be ready.",
    "homing": "Homing the table, slowly.",
    "warming_up": "Warming up, {seconds:g} s at least.",
    "checking_mounting": "Checking gravity, signs and data flow.",
    "checking_gravity": "Checking gravity's length and data flow.",
    "step_repeated": "Step repeated ({reason}), attempt {attempt}.",
    "finishing": "To the load angle, axes off.",
    "safe_stop_incomplete": "Safe stop: {text}",
    "azimuth_from_data": "{stage}: azimuth found from the data, not from the station file.",
    "not_settled": "{stage}: {passes} passes did not settle the answer; take its sigmas with care.",
    "turns_assumed_whole": "{stage}: no encoder angles; every turn is taken for whole.",
    "recording_cut": "{stage}: force jumps at rest in {count} places; nothing is taken from the motions there.",
    "motions_left_out": "{stage}: in {count} motions the gyros contradict gravity; they are left out.",
    "no_motion_between_rests": "{stage}: no motion between rests was recorded; gyro matrices are not determined.",
    "noisier_than_profile": "{stage}: the recording scatters more than the profile's noise (rests {force:.2g} m/s² "
    "and {rate:.2g} rad/s, turns {turn:.2g} rad); the sigmas count it.",
    "pair_primary_off": "{stage}: at {time:.0f} s the primary is off itself; imu{number} is not calibrated against it.",
    "pair_calibrated": "{stage}: at {time:.0f} s imu{number} was off and has been calibrated.",
    "pair_given_up": "{stage}: at {time:.0f} s calibration was given up: {why}.",
    "pair_kept": "{stage}: nothing new for secondary {numbers}; what was stored stays.",
    "gimbal_unstable": "{stage}: a gain of {gain:g} is beyond the {limit:.2f} up to which turns about {axis} converge.",
    "gimbal_axes_missing": "{stage}: no turns about {axes}; misalignments of those columns are not determined.",
    "registers_kept": "Outside the limits: the unit keeps its registers.",
    "registers_writing": "Writing the registers.",
    "registers_proved": "Registers written, read back, and the output right with them ({proof}).",
    "old_unproved": "The old registers are back as they were; the output was not looked at to its end.",
    "verifying": "Checking the output of the restarted unit.",
    "look_repeated": "The unit restarted by itself: its output is looked at again from the beginning.",
    "better_kept": "{parameter} kept: {before} from {date} is better than {now} now.",
    "better_changed": "{parameter} replaced: it is now ({now}) far from what was found on {date} ({before}).",
    "registers_transfer": "Inside the limits: writing the registers.",
    "registers_written": "Registers written, read back, and the output right with them.",
    "registers_read_back": "Registers written and read back; what the unit makes of them cannot be seen: it shows no"
    " corrected output.",
    "reference": "Looking at the unit before its registers are written.",
    "transfer_kept": "An earlier transfer to {serial} was interrupted; the unit kept its registers.",
    "transfer_open": "An earlier transfer to {serial} was interrupted ({utc}); the unit holds {holds} registers.",
    "transfer_settled": "The interrupted transfer to {serial} is settled: {closing}.",
    "journal_torn": "{file}: a power cut tore its last line, which announces nothing that happened.",
    "flash_near": "The flash of {serial} has been written {used} times of the {most} that its profile allows.",
    "log_damaged": "{file}: damaged rows left out as gaps: {rows}, samples {where}.",
    "resumed": "Carrying on {log} behind its finished stages: {stages}.",
    "transfer_unproved": "The registers are written but not verified: the next start with this unit asks whether to "
    "finish or to put the old ones back.",
    "transfer_finished": "Stop came while the registers were written: the transfer was finished first.",
    "handover_waiting": "Hand-over: {count} waiting, {folder} cannot be reached ({reason}).",
    "handover_done": "Hand-over: {count} results went to {folder}.",
    "latitude_untold": "{stage} does not fit together, and no rest of this run tells the latitude that it believes: "
    "make sure of site.latitude_deg = {latitude:g} in the station file; a run with six_position tells it.",
    "stopped_because": "Stopped safely: {reason}.",
    "stopped_early": "{stage} is outside the limits: the remaining stages are left out.",
}

STATES: dict[str, str] = {
    "idle": "idle",
    "preparing": "preparing",
    "running": "running",
    "pausing": "coming to rest",
    "paused": "paused",
    "stopping": "stopping safely",
    "stopped": "stopped",
    "fault": "fault",
    "passed": "passed",
    "failed": "failed",
    "done": "done",
}

REASONS: dict[str, str] = {
    "gap": "samples lost",
    "no_data": "no data",
    "saturated": "output saturated",
    "invalid": "output is no number",
    "signal": "the system ended the program",
    "listener_lost": "the window or terminal that watched the run is gone",
    "listener_silent": "the window or terminal that watched the run does not answer",
}

#: By what the output was found right.
PROOFS: dict[str, str] = {
    "turn": "with a turn of the table",
    "rest": "at rest, no turn was made",
    "read_back": "by reading back alone",
}

#: Of a unit whose corrected output cannot be seen.
READ_BACK = "PASSED: inside every limit, registers written and read back; the unit shows no output with them"

OUTCOMES: dict[str, str] = {
    "passed": "PASSED: inside every limit, registers written and verified",
    "failed": "FAILED: outside the limits",
    "stopped": "STOPPED",
    "fault": "FAULT",
    "incomplete": "INCOMPLETE",
}

RESOLVED: dict[bool | None, str] = {
    True: "Inside every limit of the product.",
    False: "OUTSIDE the product's limits.",
    None: "The log names no limits to compare with.",
}

#: Of a log in which a stage lacks data.
NOT_ALL = "Not every stage of the log could be solved."

#: What an acceptance check compares; parameters and stages speak for themselves.
CHECKS: dict[str, str] = {
    "gravity_at_rest": "force at rest against gravity",
    "improvement_at_rest": "force at rest against gravity, for what it was",
    "level_horizontal": "horizontal force at level",
    "level_vertical": "vertical force at level against gravity",
    "motion_angle": "angle of motions against the reference",
    "motion_improvement": "angle of motions against the reference, for what it was",
    "offline_online": "solved again against the run",
    "excitation": "part of a sigma that is left",
    "latitude": "latitude as the gyros see the earth turn",
}

#: What a move does, by the first word of its label; the others are the braces' values.
STEPS: dict[str, str] = {
    "start": "To the start of the stage",
    "position": "To outer {1:g}°, inner {2:g}°",
    "into_place": "Bringing axis {1} into place",
    "whole_turns": "Turning about {1} by {2:g}°",
    "turn_about": "Turning about {1} by {2:g}°",
    "unwind": "Unwinding before the next turn about {1}",
    "face_up": "Turning {1} up",
    "flip": "Half turn about the vertical, {1:+g}°",
    "return": "Back to the start of the step",
    "check": "A small turn to check mounting and signs",
    "verify": "A turn to verify what was written",
    "load": "To the load angle",
    "carry": "Outer rail to {1:.0f}°, inner rail to {2:.0f}°, then let go",
}


#: What a position by hand waits for.
GUIDED: dict[str, str] = {
    "waiting": "waiting: let go of it",
    "still": "hold still, {rest:.0f} of {wanted:.0f} s",
    "moving": "moving",
    "enough": "enough: go on",
    "repeat": "too soon: once more",
}

#: What came of an operator's reset of the table.
RESETS: dict[str, str] = {
    "nothing": "No fault is latched; nothing was sent.",
    "cleared": "The fault '{latched}' was reset; nothing is latched now.",
    "interlock_open": "NOT RESET: fault '{latched}' is latched and the interlock is open; close the cover, try again.",
    "moving": "NOT RESET: fault '{latched}' is latched and the table still turns; wait until it rests, try again.",
    "local_control": "NOT RESET: the table is under local control; switch it to remote control at its panel.",
    "refused": "NOT RESET: the table refuses ({words}); remove the cause of '{latched}' first.",
    "stays": "STILL THERE: '{latched}' was reset, but '{left}' is latched; its cause is still there, remove it first.",
}


def word(key: str, values: Mapping[str, Any]) -> str:
    """The sentence of a message; an unknown id is shown with its values."""
    values = {name: ", ".join(v) if isinstance(v, list) else v for name, v in values.items()}
    shown = {**values, "reason": REASONS.get(str(values.get("reason")), values.get("reason"))}
    shown["proof"] = PROOFS.get(str(values.get("proof")))
    template = MESSAGES.get(key)
    if template is None:
        details = ", ".join(f"{name} {value}" for name, value in values.items())
        return f"{key.replace('_', ' ')}{': ' if details else ''}{details}"
    return template.format(**shown)


def word_guided(event: PositionGuided) -> str:
    """What the operator is to do, and how the present position stands."""
    task = word_step("carry", ("carry", degrees(event.outer), degrees(event.inner)))
    state = GUIDED[event.state].format(rest=event.rest, wanted=event.wanted)
    return f"{event.index}/{event.count} {task}: {state}"


def word_step(kind: str, label: tuple[str | float, ...]) -> str:
    """What a step does, in a few words."""
    if kind == "dwell":
        return "Resting"
    if not label:
        return "Moving"
    template = STEPS.get(str(label[0]))
    if template is not None:
        return template.format(*label)
    return " ".join(
        f"{part:g}" if isinstance(part, float | int) else part.replace("_", " ") for part in label
    )
