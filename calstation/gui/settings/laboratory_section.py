"""The laboratory of a station with its instruments and signatories, and its operators with their badges."""

from functools import partial
from pathlib import Path

from calstation.config import BADGES, INSTRUMENTS, SIGNATORIES, Form, StationConfig, missing_report_paths
from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.fields import EDITOR, AddressEdit, Field, Row, Section, folder_row
from calstation.gui.settings.form_view import FittedForm
from calstation.gui.text import language, say
from calstation.gui.widgets import ChoiceBox, TextEdit, ask_open, button, column, label, show_text, theme
from calstation.schema import KeyPath

#: Width of the input for a name or a postal address, px.
_LONG_WIDTH = EDITOR + 14 * theme.GRID
#: Default port of a label printer.
_PRINTER_PORT = 9100
_FOLDER, _TEMPLATE, _SIGNING = ("report", "folder"), ("report", "template"), ("report", "signing", "certificate")


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
    """The section for the tables `[laboratory]`, `[[instruments]]` and `[report]` of a station file."""

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
            2 * theme.GRID,
            CertificateFields(draft),
            None,
            on=self,
        )


class CertificateFields(Section):
    """The fields for the table `[report]` of a station file: where certificates are written, and how."""

    def __init__(self, draft: Draft) -> None:
        super().__init__(draft)
        languages = ChoiceBox(
            lambda: [(None, say("settings.as_window")), *((code[:2], name) for code, name in language.LANGUAGES)]
        )
        column(
            label("settings.certificates", "section"),
            self._path_field(_FOLDER),
            folder_row("report_browse_button", draft, _FOLDER),
            Field(draft, ("report", "language"), languages, hint="setting.about_report_language"),
            self._path_field(_TEMPLATE),
            folder_row("template_browse_button", draft, _TEMPLATE),
            self._path_field(_SIGNING),
            Row(button("signing_browse_button", "settings.choose_file", self._ask_signing)),
            on=self,
        )

    def _path_field(self, key_path: KeyPath) -> Field:
        """Create a field for a path, which warns if an edited path does not exist."""
        name = f"report_{key_path[-1]}"
        hint = f"setting.about_{name}"
        field = Field(self._draft, key_path, TextEdit(), name=name, hint=hint, width=_LONG_WIDTH)
        field.warning = partial(self._missing, key_path)
        return field

    def _missing(self, key_path: KeyPath) -> str:
        """Return a warning if an edited path does not exist; a stored path may be on a share that does not respond."""
        station, path = self._draft.model, self._draft.path
        if not isinstance(station, StationConfig) or station.report is None or path is None:
            return ""
        missing = missing_report_paths(station.report, path) if self._draft.differs(key_path) else ()
        return next((say(error.code, **error.values) for error in missing if error.key_path == key_path), "")

    def _ask_signing(self) -> None:
        files, title = ["PKCS #12 (*.p12 *.pfx)"], say("setting.report_certificate")
        ask_open(self, title, Path(), files, lambda file: self._draft.set({_SIGNING: str(file)}))


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
