"""Bar that asks for the name under which a design is saved as a product."""

from collections.abc import Callable

from PySide6.QtWidgets import QFrame, QLineEdit

from calstation.config import editing, library
from calstation.gui.text import on_language_change, say
from calstation.gui.widgets import button, column, enable, label, row, show_text, theme


class SaveBar(QFrame):
    """Asks for a name; hidden until `ask`, its button calls `save` with the name."""

    def __init__(self, save: Callable[[str], None]) -> None:
        super().__init__()
        self._save_as = save
        self._source = self._locked = ""
        self.setProperty("kind", "panel")
        self._name = QLineEdit()
        self._name.setObjectName("design_name_edit")
        self._name.setFixedWidth(26 * theme.GRID)
        self._name.setMaxLength(60)
        self._name.textEdited.connect(lambda _: self._check())
        self._name.returnPressed.connect(self._save)
        self._problem, self._remark = label(kind="error", wrap=True), label(kind="caution", wrap=True)
        self._button = button("save_design_button", "common.save", self._save, kind="primary")
        #: The last widget in Tab order.
        self.last = button("cancel_save_design_button", "common.cancel", self.hide)
        inputs = row(label("engineer.product_name", buddy=self._name), self._name, None, self._button, self.last)
        margins = (2 * theme.GRID, theme.GRID, theme.GRID, theme.GRID)
        column(inputs, self._problem, self._remark, on=self, spacing=theme.GRID // 2, margins=margins)
        on_language_change(self, self._check)
        self.hide()

    def ask(self, source: str) -> None:
        """Ask for the name of the product made from the product `source`, both without suffix."""
        self._source = source
        self._name.setText(f"{source}_fast")
        self._check()
        self.show()
        self._name.setFocus()
        self._name.selectAll()

    def lock(self, why: str) -> None:
        """Disable saving for the given reason; "" enables it."""
        self._locked = why
        self._check()

    def _check(self) -> None:
        """Show the error in the name, or that the product exists."""
        name = self._name.text()
        problem = ""
        if name and not editing.is_name(name):
            problem = say("engineer.name_rule")
        elif name == self._source:
            problem = say("engineer.other_name")
        exists = not problem and name in library.names("products")
        show_text(self._problem, problem)
        show_text(self._remark, say("engineer.design_name_taken", name=name) if exists else "")
        enable(self._button, self._locked or problem or ("" if name else say("common.type_name")))

    def _save(self) -> None:
        if self._button.isEnabled():
            self.hide()
            self._save_as(self._name.text())
