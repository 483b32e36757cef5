"""The panel that shows how a recording of another program is interpreted, and imports it to a raw log."""

from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QGridLayout, QWidget

from calstation.errors import CalstationError
from calstation.gui.state import AppContext, FileExport, JobView
from calstation.gui.text import on_language_change, say, term
from calstation.gui.widgets import (
    Choice,
    JobRow,
    JobStack,
    box,
    button,
    clear,
    column,
    combo_box,
    enable,
    fill_combo,
    grid,
    label,
    line_edit,
    row,
    scroll_area,
    theme,
)
from calstation.records import SUFFIX
from calstation.results import Inspection, import_recording, look_at


class ImportPanel(JobView):
    """A panel that shows a recording before anything is written; `imported(path)` is emitted with the new log."""

    imported = Signal(object)
    closed = Signal()

    def __init__(self, app: AppContext) -> None:
        super().__init__(app, "import")
        self.path: Path | None = None
        self.inspection: Inspection | None = None
        #: Recording, configuration and topic that were read last.
        self._read: tuple[Path | None, Path | None, str | None] = None, None, None
        self.looker = self.job(look_at, self._show, failure="logs.not_understood", failed=self._choose_topic)
        self.exports = FileExport(self)
        self.exports.watch.done.connect(self.imported)
        self._title = label(kind="section")
        self.meta_edit = line_edit("import_meta_edit", hint="logs.import_meta_tip")
        self.topic_combo = combo_box("import_topic_combo", characters=30)
        self.look_button = button("import_look_button", "logs.look_again", self.look)
        self.import_button = button("import_button", "logs.import_recording", self._ask, kind="primary")
        close = button("import_close_button", "common.close", self.closed)
        meta = label("logs.import_meta", buddy=self.meta_edit)
        self._topic = label("logs.import_topic", buddy=self.topic_combo)
        self.rows: QGridLayout = grid(across=2 * theme.GRID, stretch=1)
        content = QWidget()
        column(self.rows, None, on=content)
        jobs = JobStack(
            box(row(None, close, self.import_button)),
            JobRow(self.looker, "import_look_cancel_button", "logs.looking"),
            JobRow(self.exports.watch, "import_cancel_button", "logs.importing"),
        )
        form = row(meta, (self.meta_edit, 1), self._topic, self.topic_combo, self.look_button)
        column(self._title, form, self.notice, (scroll_area(content, texts=True), 1), jobs, on=self)
        self.meta_edit.returnPressed.connect(self.look)
        self.meta_edit.textChanged.connect(self._update)
        self.topic_combo.currentIndexChanged.connect(self._update)
        self.busy_changed.connect(self._update)
        on_language_change(self, self._refresh)

    def open(self, path: Path) -> None:
        """Show another recording, read with the configuration file next to it."""
        self.path = path.absolute()
        self.meta_edit.clear()
        fill_combo(self.topic_combo, [], None)
        self.look()

    def look(self) -> None:
        """Read the recording again."""
        if self.path is None or self.busy:
            return
        self.notice.dismiss()
        self.inspection = None
        self._refresh()
        self._read = self._source
        self.looker.start(*self._read)

    @property
    def _source(self) -> tuple[Path | None, Path | None, str | None]:
        """The recording, its configuration, and the topic that was chosen."""
        typed = self.meta_edit.text().strip()
        return self.path, Path(typed).expanduser() if typed else None, self.topic_combo.currentData()

    def _show(self, inspection: Inspection) -> None:
        self.inspection = inspection
        self._refresh()
        contradicted = inspection.unit_error is not None
        theme.set_kind(self.import_button, "" if contradicted else "primary")
        (self.look_button if contradicted else self.import_button).setFocus()
        self._warn()

    def _warn(self) -> None:
        """Show a notice if the units are wrong."""
        self.notice.dismiss()
        if self.inspection is not None and self.inspection.unit_error is not None:
            self.notice.ask("bad", "logs.wrong_units", self.inspection.unit_error)

    def _choose_topic(self, error: CalstationError) -> None:
        """Offer the topics of a file with several IMUs."""
        topics = error.values.get("topics")
        if error.code == "foreign.several_imus" and isinstance(topics, list):
            fill_combo(self.topic_combo, [(str(topic), str(topic)) for topic in topics], str(topics[0]))
        self._update()

    def _ask(self) -> None:
        error = None if self.inspection is None else self.inspection.unit_error
        if error is None:
            self._ask_file()
            return
        no = Choice("import_not_choice", "logs.do_not_import", self._warn, primary=True)
        anyway = Choice("import_anyway_choice", "logs.import_anyway", self._import)
        self.notice.ask("bad", "logs.import_wrong_units", error, (no, anyway))

    def _import(self) -> None:
        self._warn()
        self._ask_file()

    def _ask_file(self) -> None:
        if self.path is not None and self.inspection is not None:
            source, meta, topic = self._read
            proposed = self.path.with_suffix(SUFFIX)
            title, kinds = say("logs.import_recording"), [f"{say('logs.log')} (*{SUFFIX})"]
            samples = self.inspection.facts.samples
            self.exports.ask(
                title, proposed, kinds, lambda target: (import_recording, source, meta, topic, target, samples)
            )

    def _refresh(self) -> None:
        clear(self.rows)
        self._title.setText("" if self.path is None else say("logs.about_recording", name=self.path.name))
        if self.inspection is not None:
            lines = [(name and say(name), say(text)) for name, text in self.inspection.summary]
            lines[1:1] = [  # before the columns, so that a reason such as a wrong unit is seen without scrolling
                (term("stage", method), say("look.solvable") if reason is None else say(reason))
                for method, reason in self.inspection.methods.items()
            ]
            for number, line in enumerate(lines):
                for index, text in enumerate(line):
                    cell = label(kind="" if index else "muted", wrap=bool(index), selectable=bool(index))
                    cell.setText(text)
                    self.rows.addWidget(cell, number, index, Qt.AlignmentFlag.AlignTop)
        self._update()

    def _why_not_import(self) -> str:
        if self.inspection is None:
            return say("logs.not_understood")
        return "" if self._source == self._read else say("logs.read_again_first")

    def _update(self, *_: object) -> None:
        wait = say("window.busy_job") if self.busy else ""
        for widget in (self.meta_edit, self.topic_combo, self.look_button):
            enable(widget, wait)
        self._topic.setVisible(self.topic_combo.count() > 0)
        self.topic_combo.setVisible(self.topic_combo.count() > 0)
        enable(self.import_button, wait or self._why_not_import())
