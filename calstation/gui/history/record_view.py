"""The record of a run: its events, and its certificates, which can be opened, printed again or revised."""

from collections.abc import Callable, Sequence

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QSizePolicy

from calstation.gui.operator import CertificateButton
from calstation.gui.state import AppContext, EventLog, JobView
from calstation.gui.text import language, on_language_change, say
from calstation.gui.widgets import Cell, CellTable, box, button, column, enable, label, row, show_text, split, theme
from calstation.messages import local_time
from calstation.records import RunRecord
from calstation.reports import IssuedCertificate, issued_certificates
from calstation.results import Result, TimedEvent, lacks_log, load_events, run_outcome

_CERTIFICATES = (
    Cell("history.certificate_number", "number", number=False, hint="file"),
    Cell("history.certificate_issued", "issued", number=False),
    Cell("history.certificate_state", "state_text", number=False, state="state"),
    Cell("history.certificate_people", "people", number=False, hint="people"),
)


class RecordView(JobView):
    """The view of the record of one run; `back` is called to return to the list."""

    def __init__(self, app: AppContext, back: Callable[[], None]) -> None:
        super().__init__(app, "record")
        self._run: RunRecord | None = None
        self._without_events = False  #: Whether the log has been read, and contains no events.
        self._certificates: Sequence[IssuedCertificate] | None = None  #: None before they have been read.
        self._events_job = self.job(load_events, self._show_events, failure="history.events_not_read")
        self._certificates_job = self.job(
            issued_certificates, self._show_certificates, failure="history.certificates_not_read"
        )
        self.back_button = button("record_back_button", "history.back_to_list", back)
        self.setFocusProxy(self.back_button)
        self._title = label(kind="section")
        self._no_events = label(kind="muted", wrap=True, name="no_events_label")
        policy = self._no_events.sizePolicy()
        policy.setVerticalPolicy(QSizePolicy.Policy.MinimumExpanding)  # it fills the space of the hidden table
        self._no_events.setSizePolicy(policy)
        self._no_events.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.events = EventLog("history_events_table")
        self.table = CellTable(
            "certificates_table", "history.certificates", _CERTIFICATES, named=False, single=True, row=4 * theme.GRID
        )
        self.table.setTextElideMode(Qt.TextElideMode.ElideMiddle)  # the end of a number states its revision
        self.table.setWordWrap(False)  # otherwise, a number would also be elided at its hyphen
        self.table.selectionModel().currentRowChanged.connect(lambda *_: self._update())
        self.table.doubleClicked.connect(lambda _: self._open())
        self._no_certificates = label(kind="muted", wrap=True, name="no_certificates_label")
        self._reason = label(wrap=True, name="certificate_reason_label")
        self._note = label(wrap=True, name="certificates_note")
        self._open_button = button("open_certificate_button", "history.open_certificate", self._open)
        self.certificate_button = CertificateButton(self.app, "record_certificate_button", self.notice, self.setFocus)
        self.certificate_button.watch.done.connect(lambda _: self._read_certificates())
        left = box(label("event_log.title", "section"), self._no_events, (self.events, 1))
        right = box(
            label("history.certificates", "section"),
            self._no_certificates,
            (self.table, 1),
            self._reason,
            self._note,
            row(self._open_button, self.certificate_button, None),
            self.certificate_button.panel,
            None,
        )
        body = split((left, 3), (right, 4), handle=2 * theme.GRID)
        column(row(self.back_button, self._title, None, spacing=2 * theme.GRID), self.notice, (body, 1), on=self)
        on_language_change(self, self._show_texts)

    def open(self, run: RunRecord, result: Result | None) -> None:
        """Show the record of a run; `result` is None for a run that cannot have certificates."""
        self.notice.dismiss()
        self._run, self._certificates, self._without_events = run, None, False
        self.events.show_events(())
        self.certificate_button.offer(result, run.result)
        if run.log.exists():
            self._events_job.start(run.log)
        self._read_certificates()
        self._show_texts()
        self.back_button.setFocus()

    def _read_certificates(self) -> None:
        if self._run is not None and not self._run.origin:
            self._certificates_job.start(self._run.log, self.app.station_path, language.current())

    def _show_events(self, events: list[TimedEvent]) -> None:
        self.events.show_events(events)
        self._without_events = not events
        self._show_texts()

    def _show_certificates(self, certificates: list[IssuedCertificate]) -> None:
        self._certificates = certificates
        self._show_texts()
        if certificates:
            self.table.selectRow(len(certificates) - 1)
        self._update()

    def _open(self) -> None:
        if (chosen := self._chosen()) is not None and chosen.pdf is not None:
            self.certificate_button.open_issued(chosen.pdf)

    def _chosen(self) -> IssuedCertificate | None:
        number, certificates = self.table.currentIndex().row(), self._certificates or ()
        return certificates[number] if 0 <= number < len(certificates) else None

    def _update(self) -> None:
        """Show why the selected certificate is a revision, and enable the button that opens it if its file exists."""
        self._open_button.setVisible(bool(self._certificates))
        chosen = self._chosen()
        revised = chosen is not None and chosen.report.reason
        values = {} if chosen is None else {"number": chosen.report.identification, "why": chosen.report.reason}
        show_text(self._reason, say("history.certificate_reason", **values) if revised else "")
        exists = chosen is not None and chosen.pdf is not None
        enable(self._open_button, "" if exists else say("history.certificate_file_missing"))

    def _show_texts(self) -> None:
        run = self._run
        if run is None:
            return
        self._title.setText(f"{run.serial}  ·  {local_time(run.started_utc, zone=True)}  ·  {say(run_outcome(run))}")
        there = run.log.exists()
        self.certificate_button.refuse(say("history.log_gone") if lacks_log(run) else "")
        no_events = "history.log_without_events" if there else "history.log_missing"
        no_events = "history.no_events" if run.origin and not there else no_events
        shown = there and not self._without_events
        show_text(self._no_events, "" if shown else say(no_events))
        self.events.setVisible(shown)
        certificates = self._certificates or ()
        last = len(certificates) - 1
        cells = {}
        for number, each in enumerate(certificates):
            report = each.report
            state, code = _state(each, last=number == last, altered=run.altered)
            cells[str(number)] = {
                "number": report.identification,
                "issued": report.issued,
                "state": state,
                "state_text": say(code),
                "people": say("common.comma").join(each.people),
                "file": "" if each.pdf is None else str(each.pdf.path),
            }
        self.table.show_cells(cells)
        self.table.setVisible(bool(cells))
        about = "released" if certificates and certificates[-1].released_since else ""
        about = "result_changed" if run.altered else about
        show_text(self._note, say(f"history.about_certificate_{about}") if cells and about else "")
        show_text(self._no_certificates, "" if cells else self._why_none(run))
        self._update()

    def _why_none(self, run: RunRecord) -> str:
        """Return why no certificate is listed; "" before they have been read."""
        if run.origin:
            return say("history.certificates_elsewhere", station=run.station or "?")
        if self._certificates is None:
            return ""
        return say("history.no_certificates" if run.log.exists() else "history.no_certificates_without_log")


def _state(certificate: IssuedCertificate, *, last: bool, altered: bool) -> tuple[str, str]:
    """Return the symbol of the state of a certificate and the code of its text; `altered` as in `RunRecord`."""
    if certificate.intact is False:
        return "bad", "history.certificate_changed" if last else "history.certificate_replaced_changed"
    if not last:
        return "none", "history.certificate_replaced"
    if altered:
        return "caution", "history.certificate_result_changed"
    if certificate.released_since:
        return "caution", "history.certificate_released"
    if certificate.pdf is None:
        return "caution", "history.certificate_without_file"
    if certificate.intact is None:
        return "caution", "history.certificate_unverified"
    return "good", "history.certificate_valid"
