"""The links to the units of a station: the link to the only unit, or the slots of the table and their links."""

from calstation.config import SLOTS, profile_takes_single_unit, with_one_unit, with_slots
from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import Section, problem_text_with_name
from calstation.gui.settings.form_view import FittedForm
from calstation.gui.settings.link_section import LinkSection
from calstation.gui.state import AppContext
from calstation.gui.text import say
from calstation.gui.widgets import box, button, column, enable, label, row, show_text, stack, theme

#: Keys of a station file whose problems are shown below the slots.
_KEYS = ("slots", "imu", "imu2", "imu3")


class _SlotsView(FittedForm):
    """The form of the slots; removing the last slot converts the station to a single unit."""

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
    """The section for the link to the only unit of a station, or for the slots and the links to their units."""

    def __init__(self, app: AppContext, draft: Draft) -> None:
        super().__init__(draft)
        self._app = app
        self._locked = ""
        #: The link to the only unit.
        self.link = LinkSection(app, "imu", draft)
        self._slot_links: list[LinkSection] = []
        self.view = _SlotsView(SLOTS)
        self.view.table.selectionModel().currentChanged.connect(lambda *_: self._show_link())
        self._about = label(kind="muted", wrap=True)
        self._problems = label(kind="error", name="slots_problems", wrap=True)
        self._slots = box(label(self.view.title, "section"), self._about, self.view, self._problems)
        self._links = stack(self.link)
        self._several_button = button(
            "several_units_button", "settings.several_units", lambda: draft.rewrite(with_slots(draft.text))
        )
        self._slots_offer = box(
            row(self._several_button, (label("setting.about_several_units", "muted", wrap=True), 1))
        )
        column(self._slots, (self._links, 1), self._slots_offer, on=self, spacing=2 * theme.GRID)
        self.connect_draft()

    @property
    def title(self) -> str:
        """The catalogue code of the name."""
        return self.view.title if self._has_slots else "settings.link_to_imu"

    @property
    def _has_slots(self) -> bool:
        return self._draft.value(("slots",)) is not None

    def lock(self, reason: str) -> None:
        """Disable changes and show `reason` in tooltips; "" enables them."""
        self._locked = reason
        self.view.lock(reason)
        for link in (self.link, *self._slot_links):
            link.lock(reason)
        self.refresh()

    def search(self) -> None:
        """Search for ports in the background."""
        self._current_link.search()

    def refresh(self) -> None:
        """Show the values of the draft."""
        draft, slots = self._draft, self._has_slots
        self._slots.setVisible(slots)
        self._slots_offer.setVisible(not slots)
        if slots:
            self.view.show_draft(draft)
            if self.view.model.rows and not self.view.table.currentIndex().isValid():
                self.view.table.setCurrentIndex(self.view.model.index(0, 0))
        bench = draft.value(("bench",)) is not None
        self._about.setText(say("setting.about_slots_of_bench" if bench else "setting.about_slots"))
        problems = [problem for problem in draft.problems if problem.key_path[:1] and problem.key_path[0] in _KEYS]
        show_text(self._problems, "\n".join(self.view.model.describe(p) or problem_text_with_name(p) for p in problems))
        enable(self._several_button, self._locked or self._why_not_several())
        self._show_link()

    def _why_not_several(self) -> str:
        """Return the reason why the station cannot have several units, or "" if it can."""
        draft = self._draft
        if draft.value(("imu2",)) is not None:
            return say("settings.one_body")
        if profile_takes_single_unit(str(draft.value(("table", "profile")) or "")):
            return say("settings.needs_table")
        return ""

    @property
    def _current_link(self) -> LinkSection:
        """The link to the only unit, or to the unit in the current row."""
        number = self.view.table.currentIndex().row() if self._has_slots else -1
        while number >= len(self._slot_links):
            link = LinkSection(self._app, "imu", self._draft, len(self._slot_links))
            link.lock(self._locked)
            self._slot_links.append(link)
            self._links.addWidget(link)
        return self.link if number < 0 else self._slot_links[number]

    def _show_link(self) -> None:
        self._links.setCurrentWidget(self._current_link)
