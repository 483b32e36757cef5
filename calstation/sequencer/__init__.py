"""Execution of runs on a table with its units: steps, protection of the table, data acquisition and events.

The package is independent of user interfaces; it writes the raw log only through `Slot.log`.
It has more than 15 modules, one for each part of the control loop and each kind of task.
"""

from calstation.sequencer.acquisition import MAX_POLL_DURATION
from calstation.sequencer.capture import DURATION, REST, mean_at_rest
from calstation.sequencer.chamber import ChamberControl, ChamberLimits
from calstation.sequencer.context import (
    Clock,
    Emit,
    LastSample,
    Output,
    PreflightLimits,
    RunContext,
    RunEnd,
    RunInBackground,
    Slot,
    Task,
    UnitDecision,
    UnitTask,
)
from calstation.sequencer.control import Command, Control, State, StopReason, StopRequested
from calstation.sequencer.driving import RunDriver
from calstation.sequencer.events import (
    LOSSY,
    ChamberChanged,
    Event,
    Fault,
    Finalized,
    GimbalTurned,
    JointsMoved,
    Message,
    PointCompleted,
    PositionGuided,
    Settled,
    StageEnded,
    StageProgress,
    StageRanked,
    StageSolved,
    StageStarted,
    StateChanged,
    StepStarted,
    TableMoved,
    Trace,
    from_json,
    solution_events,
    times,
    to_json,
)
from calstation.sequencer.guard import check_limits, check_power
from calstation.sequencer.plan import StagePlan, StopRule, plan_time, planned, stage_times, step_time
from calstation.sequencer.sequencer import Sequencer
from calstation.sequencer.tasks import chamber_limits, corrected_output, table_task, unit_task
from calstation.sequencer.units import NO_DATA, SOLVER_THREADS
from calstation.sequencer.verification_path import JointDrift, TurnData, VerificationData
