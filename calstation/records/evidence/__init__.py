"""Files of hash-chained lines, in which removed or changed lines are detected: audit trail, reports and solutions.

The code that appends a line defines its content.
"""

from calstation.records.evidence.audit import (
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
from calstation.records.evidence.chained_lines import Chain, ChainedFile
from calstation.records.evidence.reports import (
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
from calstation.records.evidence.resolves import (
    OnlineDifference,
    ResolveRecord,
    append_resolve,
    read_resolves,
    resolve_file,
)
from calstation.records.evidence.station_key import (
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
