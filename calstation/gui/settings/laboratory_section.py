"""The laboratory of a station with its instruments and signatories, and its operators with their badges."""

from calstation.config import BADGES, INSTRUMENTS, SIGNATORIES, Form
from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import EDITOR, AddressEdit, Field, Section
from calstation.gui.settings.form_view import FittedForm
from calstation.gui.text import say
from calstation.gui.widgets import TextEdit, column, label, show_text, theme

#: Width of the input for a name or a postal address, px.
_LONG_WIDTH = EDITOR + 14 * theme.GRID
#: Default port of a label printer.
_PRINTER_PORT = 9100


class FormPanel(Section):
    """A form for a list of the station file, with its heading and its problems."""

    def __init__(self, draft: Draft, form: Form) -> None:
        super().__init__(draft)
        self.view = FittedForm(form)
        self._problems = label(kind="error", name=f"{form.name}_problems", wrap=True)
        column(label(self.view.title, "section"), self.view, self._problems, on=self)
        self.connect_draft()

    def refresh(self) -> None:
        """Show the values and the problems of the list."""
        self.view.show_draft(self._draft)
        show_text(self._problems, "\n".join(filter(None, map(self.view.describe, self._draft.problems))))


class _FormsSection(Section):
    """A section with fields and forms."""

    def lock(self, reason: str) -> None:
        """Disable changes and show `reason` in tooltips; "" enables them."""
        super().lock(reason)
        for panel in self.findChildren(FormPanel):
            panel.view.lock(reason)


class LaboratorySection(_FormsSection):
    """The section for the tables `[laboratory]` and `[[instruments]]` of a station file."""

    def __init__(self, draft: Draft) -> None:
        super().__init__(draft)
        names = ("name", "address", "place", "country", "accreditation", "customer", "customer_address")
        fields = (
            Field(
                draft,
                ("laboratory", name),
                TextEdit(),
                name=f"laboratory_{name}",
                hint=f"setting.about_laboratory_{name}",
                width=_LONG_WIDTH,
            )
            for name in names
        )
        column(
            label("settings.laboratory", "section"),
            label("setting.about_laboratory", "muted", wrap=True),
            *fields,
            2 * theme.GRID,
            FormPanel(draft, SIGNATORIES),
            2 * theme.GRID,
            FormPanel(draft, INSTRUMENTS),
            None,
            on=self,
        )


class OperatorsSection(_FormsSection):
    """The section for the tables `[sign_in]` and `[label]` of a station file."""

    def __init__(self, draft: Draft) -> None:
        super().__init__(draft)
        self._status = label(name="sign_in_status_label", wrap=True)
        printer = AddressEdit("tcp", _PRINTER_PORT)
        column(
            label("settings.sign_in", "section"),
            self._status,
            Field(draft, ("sign_in", "badge_pattern"), TextEdit()),
            Field(draft, ("sign_in", "idle_minutes")),
            FormPanel(draft, BADGES),
            2 * theme.GRID,
            label("settings.labels", "section"),
            Field(draft, ("label", "printer"), printer),
            None,
            on=self,
        )
        self.connect_draft()

    def refresh(self) -> None:
        """Show who may start runs."""
        named, signs_in = (self._draft.value(path) for path in (("sign_in", "names"), ("sign_in",)))
        state = "named" if named else "any_badge" if signs_in else "none"
        self._status.setText(say(f"setting.sign_in_{state}"))
