"""Records of runs: raw logs, CSV logs, their configurations, and the index of runs.

The package contains no solvers and no device drivers. It has more than 15 modules: the sections of a log's
configuration, the steps from a file to samples, and the index. Its subpackages are the formats of logs, and `evidence`.
"""

from typing import TYPE_CHECKING, Any

from calstation.records.check_id import MODEL_KINDS, CheckId, CheckKind, read_check_ids
from calstation.records.columns import RecordingMeta
from calstation.records.convert import Correction, export_corrected, export_csv
from calstation.records.csv_logs import CSV_SUFFIXES, meta_path
from calstation.records.evidence import (
    AUDIT_EVENTS,
    KEY_VARIABLE,
    AuditEvent,
    AuditEventName,
    AuditTrail,
    Chain,
    ChainedFile,
    DatabaseHead,
    IssuedReport,
    OnlineDifference,
    ResolveRecord,
    TrailHead,
    TrailState,
    append_audit,
    append_resolve,
    audit_path,
    audit_values,
    audit_writer,
    complete_reports,
    damage_text,
    database_contradictions,
    database_heads,
    find_heads,
    head_file,
    intact_trail,
    is_signed,
    issued_reports,
    key_file,
    public_key,
    read_audit,
    read_reports,
    read_resolves,
    recorded_folders,
    recorded_people,
    report_faults,
    report_file,
    reports_head,
    reports_of_others,
    resolve_file,
    restart_trail,
    select_audit,
    site_events,
    site_trails,
    store_database_heads,
    unrecorded_reports,
    verify_trail,
)
from calstation.records.facts import LogFacts, UnusedSamples
from calstation.records.files import (
    FILE_MODE,
    acquire_lock,
    free_space,
    is_locked,
    locked,
    partial_path,
    sync_folder,
    write_atomic,
)
from calstation.records.foreign import FOREIGN_FORMATS, foreign_format
from calstation.records.indexed_run import (
    LATEST_FIRST,
    Categories,
    IndexedRun,
    RunChoices,
    RunColumns,
    RunFilter,
    RunOrder,
    RunRecord,
    estimates_by_name,
    from_columns,
    to_columns,
)
from calstation.records.laboratory import COUNTRIES, Day, InstrumentSection, LaboratorySection
from calstation.records.log import Log, damage_summary, read_truth, truth_path
from calstation.records.log_formats import LOG_FORMATS, LOG_SUFFIXES, estimated_rows, log_format, open_log
from calstation.records.meta import (
    CalibrationSection,
    FileSection,
    ImuSection,
    LogMeta,
    ModelSection,
    OverriddenSection,
    PriorSection,
    ProductSection,
    RunSection,
    SiteSection,
    TableSection,
    context_from_meta,
    correlation_of,
    covariance_from,
    load_pair,
    pair_path,
    prior_from_meta,
    store_pair,
)
from calstation.records.product import (
    NEAR_MISS_FRACTION,
    ChecksSection,
    ConformitySection,
    Excitation,
    GravityAtRest,
    ImprovementAtRest,
    Level,
    Limit,
    MotionAngle,
    Positions,
    Previous,
    Rule,
    SampleClockLimit,
    TemperatureLimit,
    TemperatureSection,
    check_limit_names,
)
from calstation.records.raw import (
    END_BY_OPERATOR,
    END_FAILING,
    RESERVED_SPACE,
    SUFFIX,
    RawLogWriter,
    being_written,
    can_be_resumed,
    completed_points,
    completed_rounds,
    last_result,
    raw_rows,
    solved_stages,
    stages_ended_by_hand,
    step_labels,
    unsolved_stages,
    write_log,
)
from calstation.records.verdict import Verdict

if TYPE_CHECKING:
    from calstation.records.run_index import RunIndex


def __getattr__(name: str) -> Any:
    """Import the index of runs on first use, because it loads SQLAlchemy, which `calstation resolve` does not need."""
    if name != "RunIndex":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from calstation.records import run_index

    return getattr(run_index, name)
