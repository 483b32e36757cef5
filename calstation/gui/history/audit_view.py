"""The audit trail of the site: who changed, released, wrote and signed, with filter, verification and export."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from calstation.config import SiteTrail, TrailLine, export_trail, trail_values
from calstation.gui.state import AppContext, FileExport, JobView
from calstation.gui.text import Words, bind, language, on_language_change, say, term
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
from calstation.messages import Text, local_time
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
        """Return the cells of a line; from the first damaged line of the trail on, with a symbol and its reason."""
        if line.event is None:
            cells = dict.fromkeys(("time", "by", "confirmed_by", "why"), "") | {"values": line.text}
            return {**cells, **_marks(line), "event": say("history.audit_line_changed", line=line.number)}
        cells = self._cells(line.event)
        if line.state == "proved":
            return cells
        marks = _marks(line)
        return {**cells, **marks, "hint": f"{marks['hint']}\n{cells['hint']}"}

    def _cells(self, each: AuditEvent) -> dict[str, str]:
        lines = [local_time(each.utc, zone=True), *trail_values(each.values, language.current())]
        if each.unproven:
            lines.append(say("common.unproven_hint"))
        return {
            "time": local_time(each.utc),
            "event": term("audit_event", each.event),
            "by": say("common.unproven", name=each.by) if each.unproven else each.by or say("history.audit_program"),
            "confirmed_by": each.confirmed_by or "",
            "why": each.why,
            "values": say("common.comma").join(trail_values(each.values, language.current(), brief=True)),
            "hint": "\n".join(lines),
        }

    def _export(self) -> None:
        lines = tuple(self._shown)
        proposed = self.app.runs_folder.absolute().parent / "audit.csv"
        kinds = ["CSV (*.csv)", "JSON (*.json)"]
        self.exports.ask(say("history.audit_export"), proposed, kinds, lambda target: (export_trail, lines, target))


def _marks(line: TrailLine) -> dict[str, str]:
    """Return the symbol and tooltip of a line that the hash chain does not verify."""
    changed = line.state == "changed"
    hint = say("history.audit_changed" if changed else "history.audit_unproved", line=line.number)
    return {"kind": "bad" if changed else "caution", "hint": hint}
