"""The links to the units: the IMU's link at a station with one unit, or the slots of the table with their links."""

from calstation.config import SLOTS, takes_one_unit, with_one_unit, with_slots
from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import Section, problem_text_with_name
from calstation.gui.settings.form_view import FormView
from calstation.gui.settings.link_section import LinkSection
from calstation.gui.state import AppContext
from calstation.gui.text import say
from calstation.gui.widgets import box, button, column, enable, label, row, show_text, stack, theme

#: Entries of a station file whose problems are shown below the slots.
_ENTRIES = ("slots", "imu", "imu2", "imu3")


class _SlotsView(FormView):
    """The form of the slots; the last slot is not removed, but becomes the only unit of the station."""

    def refresh(self) -> None:
        """Show the current values in a table as high as its rows."""
        super().refresh()
        header, line = self.table.horizontalHeader(), self.table.verticalHeader().defaultSectionSize()
        bar = self.table.horizontalScrollBar().sizeHint().height()
        self.table.setFixedHeight(header.sizeHint().height() + len(self.model.rows) * line + bar + theme.GRID)

    def _remove(self) -> None:
        if len(self.model.rows) > 1:
            super()._remove()
        else:
            self._draft.rewrite(with_one_unit(self._draft.text))

    def _enable(self) -> None:
        super()._enable()
        if len(self.model.rows) == 1 and self._buttons["remove"].isEnabled():
            self._buttons["remove"].setToolTip(say("settings.one_unit"))


class ImuSection(Section):
    """Edits the link of the only unit, or the slots and the links of their units, in the draft of a station."""

    def __init__(self, app: AppContext, draft: Draft) -> None:
        super().__init__(draft)
        self._app = app
        self._locked = ""
        #: The link at a station with one unit.
        self.link = LinkSection(app, "imu", draft)
        self._slot_links: list[LinkSection] = []
        self.view = _SlotsView(SLOTS)
        self.view.table.selectionModel().currentChanged.connect(lambda *_: self._show_link())
        self._about = label(kind="muted", wrap=True)
        self._problems = label(kind="error", name="slots_problems", wrap=True)
        self._slots = box(label(self.view.title, "section"), self._about, self.view, self._problems)
        self._links = stack(self.link)
        self._several = button("several_units_button", "settings.several_units", self._divide)
        self._offer = box(row(self._several, (label("setting.about_several_units", "muted", wrap=True), 1)))
        column(self._slots, (self._links, 1), self._offer, on=self, spacing=2 * theme.GRID)
        self.follow(draft)

    @property
    def title(self) -> str:
        """The code of the section's name."""
        return self.view.title if self._has_slots else "settings.link_to_imu"

    @property
    def _has_slots(self) -> bool:
        return self._draft.value(("slots",)) is not None

    def lock(self, reason: str) -> None:
        """Disable changes, with `reason` as the tooltip; "" enables them."""
        self._locked = reason
        self.view.lock(reason)
        for link in (self.link, *self._slot_links):
            link.lock(reason)
        self.refresh()

    def search(self) -> None:
        """Search for ports in the background."""
        self._shown_link.search()

    def refresh(self) -> None:
        """Show the draft."""
        draft, slots = self._draft, self._has_slots
        self._slots.setVisible(slots)
        self._offer.setVisible(not slots)
        if slots:
            self.view.show_draft(draft)
            if self.view.model.rows and not self.view.table.currentIndex().isValid():
                self.view.table.setCurrentIndex(self.view.model.index(0, 0))
        bench = draft.value(("bench",)) is not None
        self._about.setText(say("setting.about_slots_of_bench" if bench else "setting.about_slots"))
        problems = [problem for problem in draft.problems if problem.place[:1] and problem.place[0] in _ENTRIES]
        show_text(self._problems, "\n".join(self.view.model.describe(p) or problem_text_with_name(p) for p in problems))
        enable(self._several, self._locked or self._why_one_unit())
        self._show_link()

    def _why_one_unit(self) -> str:
        """Return the reason why the station cannot take several units, "" if it can."""
        draft = self._draft
        if draft.value(("imu2",)) is not None:
            return say("settings.one_body")
        if takes_one_unit(str(draft.value(("table", "profile")) or "")):
            return say("settings.needs_table")
        return ""

    @property
    def _shown_link(self) -> LinkSection:
        """The link of the only unit, or of the unit in the current row."""
        number = self.view.table.currentIndex().row() if self._has_slots else -1
        while number >= len(self._slot_links):
            made = LinkSection(self._app, "imu", self._draft, len(self._slot_links))
            made.lock(self._locked)
            self._slot_links.append(made)
            self._links.addWidget(made)
        return self.link if number < 0 else self._slot_links[number]

    def _show_link(self) -> None:
        self._links.setCurrentWidget(self._shown_link)

    def _divide(self) -> None:
        self._draft.rewrite(with_slots(self._draft.text))
