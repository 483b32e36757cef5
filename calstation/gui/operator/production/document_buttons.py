"""Buttons that print the label of a unit and issue or open its calibration certificate."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from PySide6.QtCore import QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QPushButton

from calstation.config import Confirmation, ConfirmationRequired, Person, computer_user
from calstation.errors import CalstationError
from calstation.gui.state import AppContext, PeoplePanel, UnitStatus, ask_to_sign_in
from calstation.gui.text import Words, bind, language, say
from calstation.gui.widgets import Choice, JobWatch, NoticeBar, plain_tip
from calstation.messages import Text
from calstation.records import IssuedReport, Verdict
from calstation.reports import (
    IssuedPdf,
    IssueState,
    PrintedLabels,
    issue_certificate,
    issue_certificates,
    issue_state,
    label_template,
    print_labels,
    product_label,
    states_of_issue,
)
from calstation.results import Result


class UnprintedNotice(NoticeBar):
    """Names the labels that were not printed, also in earlier runs, until each is printed or the notice is closed.

    `then` is called after the notice has been closed.
    """

    def __init__(self, app: AppContext, name: str, then: Callable[[], None]) -> None:
        super().__init__(name)
        self._then = then
        #: Result and reasons by the serial number of each unit.
        self._labels: dict[str, tuple[Path, Sequence[Text]]] = {}
        self._again: Callable[[dict[str, Path]], None] = lambda _: None
        app.labels_printed.connect(self._remove)

    def add(self, labels: Mapping[str, tuple[Path, Sequence[Text]]], again: Callable[[dict[str, Path]], None]) -> None:
        """Add labels by serial number, each with its result file and the reasons; `again` prints labels again."""
        self._again = again
        self._labels |= labels
        self._show()

    def _remove(self, serials: Collection[str]) -> None:
        if self._labels.keys() & set(serials):
            self._labels = {serial: label for serial, label in self._labels.items() if serial not in serials}
            self._show()

    def _show(self) -> None:
        if not self._labels:
            self.dismiss()
            return
        reasons = [reason for _, each in reversed(self._labels.values()) for reason in each]
        again = Choice("print_again_button", "operator.print_again", self._print)
        close = Choice(f"{self.objectName()}_close", "common.close", self._close)
        title = Text.of("operator.label_not_printed", serials=list(self._labels))
        texts = *reasons, Text("operator.label_later")
        self.ask("bad", title, lambda: "\n".join(dict.fromkeys(map(say, texts))), (again, close))

    def _print(self) -> None:
        """Print the labels again; the notice stays until they have been printed."""
        self._show()
        self._again({serial: file for serial, (file, _) in self._labels.items()})

    def _close(self) -> None:
        self._labels = {}
        self._then()


class _DocumentButton(QPushButton):
    """Button that creates a document for a result; `then` is called after the notice about it has been closed."""

    def __init__(self, app: AppContext, name: str, notice: NoticeBar, then: Callable[[], None]) -> None:
        super().__init__()
        self.setObjectName(name)
        self._app, self._notice, self._then = app, notice, then
        self._busy, self._why_not = False, ""
        self.hide()

    def refuse(self, why_not: str) -> None:
        """Disable the button with the reason as its tooltip; "" enables it."""
        self._why_not = why_not
        self.setToolTip(plain_tip(why_not))
        self._set_busy(self._busy)

    def open(self, pdf: Path) -> None:
        """Open a PDF; if this computer has no program for it, a notice names the file."""
        if not _opens(pdf):
            self._notice.inform("caution", "operator.no_pdf_viewer", lambda: str(pdf), self._then)

    def _set_busy(self, busy: bool) -> None:
        """Disable the button during a job, without giving its focus to the next button."""
        self._busy = busy
        if busy:
            self.clearFocus()
        self.setEnabled(not busy and not self._why_not)


class LabelButton(_DocumentButton):
    """Button that prints the label of a unit, or of `all_units`, if they passed and their product has a label.

    `unprinted` says which labels were not printed, and offers to print them again.
    """

    def __init__(
        self,
        app: AppContext,
        name: str,
        notice: NoticeBar,
        then: Callable[[], None],
        *,
        unprinted: UnprintedNotice,
        all_units: bool = False,
    ) -> None:
        super().__init__(app, name, notice, then)
        self._unprinted = unprinted
        #: Result files by serial number whose labels the button prints, and those of the last print job.
        self._files: dict[str, Path] = {}
        self._printing: dict[str, Path] = {}
        self._watch = app.job(self, print_labels, self._printed, failed=self._not_printed)
        self._watch.busy_changed.connect(lambda: self._set_busy(self._watch.busy))
        self.clicked.connect(lambda: self._print(self._files))
        bind(self, "operator.print_labels" if all_units else "operator.print_label")

    def offer(self, result: Result | None, result_file: Path | None) -> None:
        """Show the button if the result has a label."""
        self.offer_all([] if result is None or result_file is None else [(result, result_file)])

    def offer_all(self, units: Sequence[tuple[Result, Path]]) -> None:
        """Show the button if any of the results, which are given with their files, has a label."""
        labelled: dict[tuple[str | None, Verdict], bool] = {}
        self._files = {}
        for result, path in units:
            key = result.product, result.verdict
            if key not in labelled:
                labelled[key] = _has_label(result)
            if labelled[key]:
                self._files[result.serial] = path
        self.setVisible(bool(self._files))

    def _print(self, files: dict[str, Path]) -> None:
        app, self._printing = self._app, dict(files)
        author = app.author if app.person else Confirmation(computer_user() or "-")
        self._watch.start(list(files.values()), app.station_path, author)

    def _not_printed(self, error: CalstationError) -> None:
        self._end_printing(dict.fromkeys(self._printing.values(), (error.as_text,)))

    def _printed(self, printed: PrintedLabels) -> None:
        pdfs = printed.pdfs
        errors: dict[Path, Sequence[Text]] = {file: [why] for file, why in printed.errors.items()}
        kind = "caution" if printed.cautions else "good"
        saved = pdfs[0].parent if len(pdfs) > 1 else pdfs[0] if pdfs else None  # several are printed from their folder
        if saved is not None and not _opens(saved):
            why = [*printed.cautions, Text.of("operator.label_not_opened", file=saved)]
            errors = {file: errors.get(file, why) for file in self._printing.values()}
        serials = self._end_printing(errors)
        if saved is not None and serials:
            code = "operator.labels_saved" if len(pdfs) > 1 else "operator.label_saved"
            self._notice.inform(kind, code, lambda: "\n".join([*map(say, printed.cautions), str(saved)]), self._then)
        elif serials:
            title = Text.of("operator.labels_printed", serials=serials)
            self._notice.ask(kind, title, lambda: "\n".join(map(say, printed.cautions)))
        self._then()

    def _end_printing(self, errors: Mapping[Path, Sequence[Text]]) -> list[str]:
        """Note the labels of the results in `errors` as not printed; return the serial numbers of the others."""
        failed = {serial: (file, errors[file]) for serial, file in self._printing.items() if file in errors}
        serials = [serial for serial in self._printing if serial not in failed]
        self._app.labels_printed.emit(serials)
        if failed:
            self._unprinted.add(failed, self._print)
        return serials


def _opens(path: Path) -> bool:
    """Open a PDF or a folder, and return whether this computer has a program for it."""
    return QDesktopServices.openUrl(QUrl.fromLocalFile(str(path)))


def label_void(app: AppContext, unit: UnitStatus) -> bool:
    """Return whether a unit that failed has a label of a run that it passed before."""
    if unit.verdict is not Verdict.FAILED or unit.result is None or not _labelled(unit.result):
        return False
    return app.history().passed_before(unit.serial) is not None


def _labelled(result: Result) -> bool:
    """Return whether the unit gets a label when it passes; a check standard gets none."""
    try:
        return result.check_standard is None and product_label(result) is not None
    except CalstationError:  # the operator page reports an unreadable product
        return False


def _has_label(result: Result) -> bool:
    try:
        return label_template(result) is not None
    except CalstationError:  # the operator page reports an unreadable product
        return False


class _IssueButton(_DocumentButton):
    """Button that issues certificates of the results in `_source`; one job reads the issued ones, another one issues.

    The caller lays out `panel`, in which people confirm the issue.
    """

    def __init__(self, app: AppContext, name: str, notice: NoticeBar, then: Callable[[], None]) -> None:
        super().__init__(app, name, notice, then)
        self._source: Path | list[Path] | None = None
        self._asked: Path | list[Path] | None = None  #: Source for which the button was pressed last.
        self.panel = PeoplePanel(name)

    def _connect(self, title: str, state_watch: JobWatch, watch: JobWatch) -> None:
        """Connect the jobs; `title` is the code of the text of the button while no job is running."""
        self._title, self._state_watch, self.watch = title, state_watch, watch
        for each in (state_watch, watch):
            each.failed.connect(self._report)
            each.busy_changed.connect(self._show_busy)
        watch.progress.connect(lambda *_: self._show_busy())
        watch.done.connect(lambda _: self.panel.hide())
        self.clicked.connect(self._ask)
        bind(self, self._text)

    def _text(self) -> str:
        job = self.watch.job if self._asked == self._source else None
        return say(self._title) if job is None else say("operator.certificate_progress", percent=100 * job.fraction)

    def _show_busy(self) -> None:
        self._set_busy(self._state_watch.busy or self.watch.busy)
        self.setText(self._text())
        self.panel.show_progress(self._text if self.watch.busy else "")

    def _report(self, error: CalstationError) -> None:
        """Report an error, in the panel if it is open; the panel keeps what was entered, except the PINs."""
        if self.panel.isHidden():
            self._notice.report("operator.no_certificate", error, self._then)
        else:
            self.panel.retry(error)

    def _ask(self) -> None:
        self.panel.hide()
        self._asked = self._source
        self._state_watch.start(self._source, self._app.station_path, language.current())

    def _by(self, required: ConfirmationRequired) -> str:
        """Return the person at the window, "" if unknown."""
        return (self._app.badge if required.badge else self._app.person) or ""

    def _person(self, required: ConfirmationRequired) -> Person | None:
        """Return the person at the window, otherwise the user of the computer.

        Returns None, with a notice, if nobody has signed in at a station with badges.
        """
        if required.badge and self._app.badge_required:
            ask_to_sign_in(
                self._app, self._notice, "operator.no_certificate", "operator.certificate_sign_in", self._then
            )
            return None
        unlocked = self._app.author.pin == "personal"
        return Person(self._by(required) or computer_user() or "-", unlocked=unlocked)


class CertificateButton(_IssueButton):
    """Button that issues the calibration certificate of a result, or opens it and offers a revision.

    The panel asks for the reason for a revision and, if the product requires it, for two people.
    """

    def __init__(self, app: AppContext, name: str, notice: NoticeBar, then: Callable[[], None]) -> None:
        super().__init__(app, name, notice, then)
        self._again = False  #: Whether an issued certificate is printed again.
        jobs = app.job(self, issue_state, self._begin), app.job(self, issue_certificate, self._issued)
        self._connect("operator.certificate", *jobs)

    def offer(self, result: Result | None, result_file: Path | None) -> None:
        """Show the button if the result has parameters."""
        if result_file != self._source:
            self.panel.hide()
        self._source = result_file
        self._show_busy()
        self.setVisible(result is not None and result_file is not None and bool(result.parameters))

    def _begin(self, state: IssueState) -> None:
        """Issue the certificate, after a question if the run is simulated, or show the one that has been issued."""
        if state.simulated:
            issue = Choice("certificate_simulated_button", "operator.issue_simulated", partial(self._issue_new, state))
            close = Choice("certificate_close_button", "common.close", self._then, primary=True)
            title, about = "operator.ask_certificate_simulated", "operator.about_certificate_simulated"
            self._notice.ask("caution", title, about, (issue, close))
        else:
            self._issue_new(state)

    def _issue_new(self, state: IssueState) -> None:
        """Issue the certificate, after asking for two people if required, or show the one that has been issued."""
        if state.last is None and state.required.second:
            self._ask_people("operator.ask_certificate", state)
        elif state.last is None or (state.pdf is None and not state.changes):
            if (person := self._person(state.required)) is not None:
                self._issue(state, person)
        else:
            self._show_issued(state, state.last)

    def _show_issued(self, state: IssueState, last: IssuedReport) -> None:
        why = Text.of("operator.why_revised", number=last.identification)
        ask = partial(self._ask_people, why, state, reason=True)
        revise = Choice("certificate_revise_button", "operator.issue_revision", ask)
        choices = [Choice("certificate_close_button", "common.close", self._then), revise]
        if (pdf := state.pdf) is not None:
            if pdf.intact() is False:
                self._show_changed(pdf.path, choices)
                return
            choices.append(
                Choice("certificate_open_button", "common.open", lambda: self.open_issued(pdf), primary=True)
            )
        self._notice.ask(
            "none" if state.pdf is not None and not state.changes else "caution",
            Text.of("operator.certificate_issued_on", number=last.identification, date=last.issued),
            lambda: "\n".join(say(f"operator.certificate_since_{each}") for each in state.changes),
            choices,
        )

    def open_issued(self, pdf: IssuedPdf) -> None:
        """Open the PDF of an issued certificate, unless it was changed after its issue, which a notice states."""
        if pdf.intact() is False:
            self._show_changed(pdf.path, [Choice("certificate_close_button", "common.close", self._then)])
        else:
            self.open(pdf.path)

    def _show_changed(self, pdf: Path, choices: Sequence[Choice]) -> None:
        title = Text.of("operator.certificate_changed", file=pdf.name)
        self._notice.ask("bad", title, Text.of("operator.about_certificate_changed", file=pdf), choices)

    def _ask_people(self, title: Words, state: IssueState, *, reason: bool = False) -> None:
        def confirmed(why: str, first: Person, second: Person | None) -> None:
            request = replace(state.request, received=self.panel.received)
            self._issue(replace(state, request=request), first, second, why if reason else None)

        note = ("operator.revision_changed" if state.changes else "operator.revision_same") if reason else ""
        by = self._by(state.required)
        self.panel.ask(title, state.required, confirmed, by=by, reason=reason, note=note, received=True)

    def _issue(self, state: IssueState, first: Person, second: Person | None = None, revise: str | None = None) -> None:
        if self.watch.busy:
            return
        self._again = state.last is not None and revise is None
        self.watch.start(replace(state.request, first=first, second=second, revise=revise))

    def _issued(self, pdf: Path) -> None:
        free = self.window().focusWidget() is None  # unless the operator has begun something else
        self._notice.ask(
            "good",
            "operator.certificate_printed" if self._again else "operator.certificate_issued",
            lambda: str(pdf),
            (
                Choice("certificate_close_button", "common.close", self._then),
                Choice("certificate_open_button", "common.open", lambda: self.open(pdf), primary=free),
            ),
        )


class CertificatesButton(_IssueButton):
    """Button that issues the certificates of several units, except those that have been issued.

    The panel asks for two people if a product requires it.
    """

    def __init__(self, app: AppContext, name: str, notice: NoticeBar, then: Callable[[], None]) -> None:
        super().__init__(app, name, notice, then)
        jobs = app.job(self, states_of_issue, self._begin), app.job(self, issue_certificates, self._issued)
        self._connect("operator.certificates", *jobs)

    def offer_all(self, units: Sequence[tuple[Result, Path]]) -> None:
        """Show the button if any of the results, which are given with their files, has parameters."""
        self.panel.hide()
        self._source = [path for result, path in units if result.parameters]
        self.setVisible(bool(self._source))

    def _begin(self, states: list[IssueState]) -> None:
        """Issue the certificates that are missing, after confirmation by two people if it is required."""
        missing = [state for state in states if state.last is None]
        if not missing:
            self._notice.inform("none", "operator.certificates_exist", "", self._then)
            return
        # the slots may have different products; the strictest of them decides
        required = max((state.required for state in missing), key=lambda each: (each.second, each.badge, each.pin))
        if not required.second:
            if (person := self._person(required)) is not None:
                self.watch.start([replace(state.request, first=person) for state in missing])
            return

        def confirmed(_: str, first: Person, second: Person | None) -> None:
            if not self.watch.busy:
                received = self.panel.received
                requests = [replace(state.request, first=first, second=second) for state in missing]
                self.watch.start([replace(request, received=received) for request in requests])

        title, by = Text.of("operator.ask_certificates", count=len(missing)), self._by(required)
        self.panel.ask(title, required, confirmed, by=by, received=True)

    def _issued(self, pdfs: list[Path]) -> None:
        title = Text.of("operator.certificates_issued", count=len(pdfs))
        self._notice.inform("good", title, lambda: str(pdfs[0].parent), self._then)
