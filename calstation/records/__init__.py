"""Records of runs: raw logs, CSV, their configuration, and the index of runs.

The package contains no solvers and no devices. It has more than 15 modules, one for each format of records.
"""

from typing import TYPE_CHECKING, Any

from calstation.records.audit import (
    AUDIT_EVENTS,
    AuditEvent,
    AuditEventName,
    AuditTrail,
    TrailState,
    append_audit,
    audit_path,
    audit_writer,
    damage_text,
    public_key,
    read_audit,
    recorded_people,
    restart_trail,
    select_audit,
    site_events,
    site_trails,
    verify_trail,
)
from calstation.records.chained_lines import Chain, ChainedFile
from calstation.records.check_id import MODEL_KINDS, CheckId, CheckKind, read_check_ids
from calstation.records.columns import RecordingMeta
from calstation.records.convert import Correction, export_corrected, export_csv
from calstation.records.csv_log import CSV_SUFFIXES
from calstation.records.facts import LogFacts
from calstation.records.files import (
    FILE_MODE,
    acquire_lock,
    free_space,
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
from calstation.records.raw_log import RESERVED_SPACE, SUFFIX, RawLogWriter, write_log
from calstation.records.raw_read import (
    END_BY_OPERATOR,
    END_FAILING,
    being_written,
    can_be_resumed,
    completed_points,
    last_result,
    raw_rows,
    solved_stages,
    stages_ended_by_hand,
    step_labels,
    unsolved_stages,
)
from calstation.records.reports import (
    IssuedReport,
    audit_values,
    complete_reports,
    database_contradictions,
    intact_trail,
    issued_reports,
    read_reports,
    recorded_folders,
    report_faults,
    report_file,
    reports_head,
    reports_of_others,
    unrecorded_reports,
)
from calstation.records.resolves import OnlineDifference, ResolveRecord, append_resolve, read_resolves, resolve_file
from calstation.records.station_key import (
    KEY_VARIABLE,
    DatabaseHead,
    TrailHead,
    database_heads,
    find_heads,
    head_file,
    is_signed,
    key_file,
    store_database_heads,
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
