"""The audit trail of the site: who changed, released, wrote and signed, with filter, verification and export."""

from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any

from calstation.config import SiteTrail, TrailLine, export_trail
from calstation.gui.state import AppContext, FileExport, JobView
from calstation.gui.text import Words, bind, on_language_change, say, term
from calstation.gui.widgets import (
    Cell,
    CellTable,
    JobRow,
    JobStack,
    StateIcon,
    box,
    button,
    column,
    combo_box,
    enable,
    fill_combo,
    label,
    line_edit,
    row,
    show_text,
    theme,
)
from calstation.messages import Text, known, local_time
from calstation.records import AUDIT_EVENTS, AuditEvent
from calstation.reports import read_verified_trail

_COLUMNS = (
    Cell("common.time", "time", number=False, hint="hint"),
    Cell("history.audit_event", "event", number=False, state="kind", hint="hint"),
    Cell("history.audit_by", "by", number=False, hint="hint"),
    Cell("history.audit_confirmed_by", "confirmed_by", number=False, hint="hint"),
    Cell("history.audit_why", "why", number=False, hint="why"),
    Cell("history.audit_values", "values", number=False, hint="hint"),
)
_PERIODS: dict[int | None, Words] = {
    None: "history.any_time",
    **{days: Text.of("common.last_days", days=days) for days in (7, 30, 365)},
}
#: Values that come first, in this order.
_FIRST = ("serial", "certificate", "validation", "verdict", "simulated")
#: Ends of the names of values that only the hint shows: digests, versions of all packages, heads of files.
_IN_HINT = ("sha256", "identity", "reports", "trail")
#: Maximum number of parts of a value, such as versions, that the hint shows.
_MAX_PARTS = 6
#: Value with the changed entries of a file.
_CHANGED = "changed"
#: Families of the terms of the program among the values.
_FAMILIES: dict[str, Callable[[str], str]] = {
    "kind": partial(term, "file_kind"),
    "pin": partial(term, "audit_pin"),
    "what": partial(term, "audit_registers"),
    "verdict": lambda name: term("report_verdict" if known(f"report_verdict.{name}") else "badge", name),
}


class AuditView(JobView):
    """The view of the audit trail, the latest event first; `back` is called to return to the list of runs."""

    def __init__(self, app: AppContext, back: Callable[[], None]) -> None:
        super().__init__(app, "audit")
        self._trail: SiteTrail | None = None
        self._shown: list[TrailLine] = []
        self._reader = self.job(read_verified_trail, self._show_trail, failure="history.audit_not_read")
        self.exports = FileExport(self)
        self.back_button = button("audit_back_button", "history.back_to_list", back)
        self.setFocusProxy(self.back_button)
        self._icon, self._state = StateIcon(20), label(wrap=True, name="audit_state_label", selectable=True)
        self._faults = label(kind="error", wrap=True, name="audit_faults_label", selectable=True)
        self._cautions = label(kind="caution", wrap=True, name="audit_cautions_label", selectable=True)
        self._verified = ""  #: Time of the verification.
        self._search = line_edit("audit_search_edit", self._refresh, hint="history.audit_search")
        self._event, self._person = (combo_box(f"audit_{name}_combo", characters=14) for name in ("event", "person"))
        self._period = combo_box("audit_time_combo", _PERIODS, characters=10)
        for combo, words in (
            (self._event, "history.audit_event"),
            (self._person, "history.audit_by"),
            (self._period, "common.time"),
        ):
            combo.currentIndexChanged.connect(lambda _: self._refresh())
            bind(combo.setAccessibleName, words)
        bind(self._search.setAccessibleName, "history.audit_search")
        self._verify_button = button(
            "audit_verify_button", "history.audit_verify", self._read, tip="history.audit_verify_tip"
        )
        self._export_button = button("audit_export_button", "history.export_list", self._export)
        self._count = label(kind="muted", name="audit_count_label")
        self.table = CellTable(
            "audit_table", "history.audit_trail", _COLUMNS, named=False, row=theme.BUTTON - theme.GRID
        )
        jobs = JobStack(
            box(row(None, self._count, self._verify_button, self._export_button)),
            JobRow(self._reader, "audit_cancel_button"),
            JobRow(self.exports.watch, "audit_export_cancel_button"),
        )
        filters = ((self._search, 3), (self._event, 2), (self._person, 2), (self._period, 1))
        column(
            row(self.back_button, label("history.audit_trail", "section"), (jobs, 1), spacing=2 * theme.GRID),
            self.notice,
            row(self._icon, (column(self._faults, self._cautions, self._state, spacing=0), 1)),
            row(*filters),
            (self.table, 1),
            on=self,
        )
        on_language_change(self, self._show_texts)

    def open(self) -> None:
        """Read and verify the audit trail."""
        self.notice.dismiss()
        self._read()
        self.back_button.setFocus()

    def _read(self) -> None:
        self._reader.start(self.app.station_path, self.app.runs_folder)

    def _show_trail(self, trail: SiteTrail) -> None:
        self._trail, self._verified = trail, local_time(datetime.now(UTC).isoformat(), zone=True)
        self._show_texts()

    def _show_texts(self) -> None:
        trail = self._trail
        entries = () if trail is None else trail.trail.entries
        acted = {name for each in entries for name in (each.by, each.confirmed_by) if name}
        people = () if trail is None else sorted({trail.people[name] for name in acted})
        names = dict.fromkeys((*AUDIT_EVENTS, *(each.event for each in entries)))
        events = [(term("audit_event", name), name) for name in names]
        fill_combo(self._event, [(say("history.audit_every_event"), ""), *events])
        fill_combo(self._person, [(say("history.audit_everyone"), ""), *((name, name) for name in people)])
        faults, cautions = ((), ()) if trail is None else (trail.faults, trail.cautions)
        is_begun = trail is not None and trail.trail.digests
        self._icon.set_kind("bad" if faults else "caution" if cautions else "good" if is_begun else "none")
        others = () if trail is None else tuple(each for each in trail.state if each not in (*faults, *cautions))
        show_text(self._faults, "\n".join(map(say, faults)))
        show_text(self._cautions, "\n".join(map(say, cautions)))
        code = "history.audit_verified_warning" if cautions else "history.audit_verified"
        counts = {"count": len(faults), "cautions": len(cautions)}
        verified = [say(code, time=self._verified, **counts)] if trail is not None else []
        self._state.setText("\n".join([*verified, *map(say, others)]))
        self._refresh()

    def _refresh(self, _: object = None) -> None:
        """List the events that meet the filters."""
        days = self._period.currentData()
        since = "" if days is None else (datetime.now(UTC) - timedelta(days=days)).isoformat()
        event, person = self._event.currentData() or None, self._person.currentData() or None
        chosen = [] if self._trail is None else self._trail.select(event, person, since)
        words = self._search.text().lower().split()
        rows = [(each, self._line_cells(each)) for each in reversed(chosen)]
        rows = [
            (each, cells) for each, cells in rows if all(word in " ".join(cells.values()).lower() for word in words)
        ]
        self._shown = [each for each, _ in rows]
        self.table.show_cells({str(number): cells for number, (_, cells) in enumerate(rows)})
        self._count.setText(
            say("history.audit_count", shown=len(rows), count=0 if self._trail is None else self._trail.lines)
        )
        enable(self._export_button, "" if rows else say("history.nothing_to_export"))

    def _line_cells(self, line: TrailLine) -> dict[str, str]:
        """Return the cells of a line; from the first damage of the trail on it has a symbol and says why."""
        if line.event is None:
            cells = dict.fromkeys(("time", "by", "confirmed_by", "why"), "") | {"values": line.text}
            return {**cells, **_marks(line), "event": say("history.audit_line_changed", line=line.number)}
        cells = self._cells(line.event)
        if line.state == "proved":
            return cells
        marks = _marks(line)
        return {**cells, **marks, "hint": f"{marks['hint']}\n{cells['hint']}"}

    def _cells(self, each: AuditEvent) -> dict[str, str]:
        values = {name: value for name, value in each.values.items() if not name.endswith(_IN_HINT)}
        lines = [local_time(each.utc, zone=True), *_value_lines(each.values)]
        if each.unproven:
            lines.append(say("common.unproven_hint"))
        return {
            "time": local_time(each.utc),
            "event": term("audit_event", each.event),
            "by": say("common.unproven", name=each.by) if each.unproven else each.by or say("history.audit_program"),
            "confirmed_by": each.confirmed_by or "",
            "why": each.why,
            "values": say("common.comma").join(_value_lines(values, names_only=True)),
            "hint": "\n".join(lines),
        }

    def _export(self) -> None:
        lines = tuple(self._shown)
        proposed = self.app.runs_folder.absolute().parent / "audit.csv"
        kinds = ["CSV (*.csv)", "JSON (*.json)"]
        self.exports.ask(say("history.audit_export"), proposed, kinds, lambda target: (export_trail, lines, target))


def _marks(line: TrailLine) -> dict[str, str]:
    """Return symbol and tooltip of a line that the chain does not prove."""
    changed = line.state == "changed"
    hint = say("history.audit_changed" if changed else "history.audit_unproved", line=line.number)
    return {"kind": "bad" if changed else "caution", "hint": hint}


def _value_lines(values: Mapping[str, Any], *, names_only: bool = False) -> list[str]:
    """Return the values of an event, and the entries of a file that changed, each with its name.

    Of a value with parts, such as the SHA-256 of files by name, only the names are shown with `names_only`.
    """
    ordered = {name: values[name] for name in (*_FIRST, *values) if name in values}
    lines = [
        f"{term('audit_value', name)} {_value_text(name, value, names_only=names_only)}".rstrip()
        for name, value in ordered.items()
        if name != _CHANGED and value not in (None, "", [])
    ]
    changed = values.get(_CHANGED)
    if isinstance(changed, dict):
        lines += [
            f"{_entry_name(key)}: {_changed_text(before)} → {_changed_text(after)}"
            for key, (before, after) in changed.items()
        ]
    return lines


def _part_text(name: str, part: Any) -> str:
    """Return a part of a value with its name, which is a term of the program or for example the name of a file."""
    title = term("audit_value", name) if known(f"audit_value.{name}") else name
    return f"{title} {part}".rstrip()


def _entry_name(key: str) -> str:
    """Return the name of an entry of a file on the Station page with its key, or only the key."""
    parts = key.split(".")
    # the last part of an entry of a list, such as the product of a slot, has another name elsewhere
    names = ("_".join(parts), *([] if any(part.isdigit() for part in parts) else parts[-1:]))
    name = next((each for each in names if known(f"setting.{each}")), None)
    return key if name is None else say("history.audit_entry", name=say(f"setting.{name}"), key=key)


def _changed_text(value: Any) -> str:
    """Return a value of a file; a missing one is shown as a dash."""
    if isinstance(value, list):
        return say("common.comma").join(map(_changed_text, value))
    return "–" if value is None else str(value)


def _value_text(name: str, value: Any, *, names_only: bool) -> str:
    """Return a value of an event, in the current language if it is a term of the program; "" for True."""
    if value is True:
        return ""
    if isinstance(value, dict):
        parts = [_part_text(key, "" if names_only else part) for key, part in list(value.items())[:_MAX_PARTS]]
        return say("common.comma").join(parts) + ("…" if len(value) > _MAX_PARTS else "")
    if isinstance(value, list):
        return say("common.comma").join(map(str, value))
    return _FAMILIES[name](str(value)) if name in _FAMILIES else str(value)
