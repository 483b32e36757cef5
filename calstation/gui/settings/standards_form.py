"""The form of a product's check standards, with the reference values of the chosen one."""

from calstation.config import Form, reference_form
from calstation.gui.settings.drafts import Draft
from calstation.gui.settings.form_view import FittedForm, FormModel, FormView
from calstation.gui.text import on_language_change, say
from calstation.gui.widgets import box, label, theme
from calstation.schema import Problem


class StandardsForm(FittedForm):
    """The form of the check standards; a second form shows the reference values of the standard in the current row."""

    def __init__(self, form: Form) -> None:
        self.reference = FormView(reference_form(0))
        self._title = label(kind="section", name="reference_title")
        self._chosen = box(theme.GRID, self._title, (self.reference, 1))
        super().__init__(form, (self._chosen, 1), None)
        self.table.selectionModel().currentChanged.connect(lambda *_: self._show_reference())
        on_language_change(self, self._show_reference)

    def show_draft(self, draft: Draft) -> None:
        """Show the values of a draft."""
        super().show_draft(draft)
        if self.model.rows and not self.table.currentIndex().isValid():
            self.table.setCurrentIndex(self.model.index(0, 0))
        self._show_reference()

    def lock(self, reason: str) -> None:
        """Disable changes and show `reason` in tooltips; "" enables them."""
        super().lock(reason)
        self.reference.lock(reason)

    def describe(self, problem: Problem) -> str:
        """Return a sentence on a problem with the names of its row and column, or "" if it is not in this form."""
        number = _reference_number(problem)
        if number is None:
            return super().describe(problem)
        if len(problem.key_path) == 3:
            return say("form.no_reference", number=number + 1)
        values = FormModel(reference_form(number))
        values.show_draft(self._draft)
        return say("form.cell", row=say("form.row", number=number + 1), column=values.describe(problem))

    def go_to(self, problem: Problem) -> bool:
        """Select the cell of a problem, and return whether it belongs to this form."""
        number = _reference_number(problem)
        if number is None or len(problem.key_path) == 3:
            return super().go_to(problem)
        self.table.setCurrentIndex(self.model.index(number, 0))
        return self.reference.go_to(problem)

    def _show_reference(self) -> None:
        """Show the reference values of the standard in the current row."""
        number = self.table.currentIndex().row()
        self._chosen.setVisible(number >= 0)
        if number >= 0:
            serial = self._draft.value(("check_standards", number, "serial"))
            self._title.setText(say("form.reference_of", serial=serial or "–"))
            self.reference.show_form(reference_form(number), self._draft)


def _reference_number(problem: Problem) -> int | None:
    """Return the number of the check standard to whose reference a problem belongs, or None."""
    if len(problem.key_path) < 3 or problem.key_path[0] != "check_standards" or problem.key_path[2] != "reference":
        return None
    number = problem.key_path[1]
    return number if isinstance(number, int) else None
