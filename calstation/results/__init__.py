"""Solver chain, solving of logs, results, history and hand-over; uses no devices and contains no estimators.

The package has more than 15 modules, one for each way to create, read or deliver a result.
"""

from calstation.estimation.common import CREEP, EXCESSIVE, NOTABLE, PositionResidual
from calstation.estimation.pairs import WatchEvent
from calstation.results.building import Ending, build_result, solved_parameters, stated_by_log
from calstation.results.calibration import current_calibration, estimate_of
from calstation.results.corrected import CorrectedOutput, CorrectedStream, CorrectedTrace, CorrectedTraceBuilder
from calstation.results.diagnostics import Diagnostics, StageDiagnostics, diagnose, stage_diagnostics
from calstation.results.handover import Delivery, HandOver, deliver_pending, register_pending
from calstation.results.history import (
    History,
    ShiftCount,
    check_runs,
    count_shift,
    load_results,
    number_ranges,
    refresh_history,
    shift_start,
)
from calstation.results.inspection import Inspection, inspect_log, inspect_recording, look_at, recording_faults
from calstation.results.offline import (
    drop_partial,
    export_log,
    export_result,
    export_runs,
    import_recording,
    offline_solve,
)
from calstation.results.outcome import run_outcome, solved_offline, value_decisions
from calstation.results.override import override_required, override_result, run_files
from calstation.results.pairs import (
    PairCheckResult,
    PairProgress,
    PairSession,
    PairWatchResult,
    check_pair,
    pair_report,
    progress_from_note,
    watch_log,
)
from calstation.results.preview import Preview, StagePreview, Violation, compute_preview
from calstation.results.resolving import (
    FinishedRun,
    Resolved,
    find_log,
    load_finished_run,
    resolve,
    resolve_log,
    resolve_with_state,
    result_of,
    stored_result,
    warm_up,
    with_states,
)
from calstation.results.result import (
    SCHEMA,
    Result,
    TemperatureResult,
    in_sigma,
    load_result,
    online_difference,
    plain,
    write_json,
)
from calstation.results.run_events import TimedEvent, load_events
from calstation.results.sections import CyclePhase, Parameter, Registers, Temperature, Verification
from calstation.results.solver_chain import StageChain, one_blas_thread, solve
from calstation.results.stated import (
    ADDED_LATER,
    RELEASE_IN_DOUBT,
    altered_entry,
    difference,
    entry_text,
    is_release_recorded,
    load_confirmed_result,
    load_run_result,
    override_of,
    require_recorded_release,
    run_log,
    was_simulated,
)
from calstation.results.stored_runs import changed_entry, ended_result, lacks_log, result_doubt
from calstation.results.temperature import compensate_samples, known_temperatures
