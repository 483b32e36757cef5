"""Table of the checks of a result: description, value, limit, margin and verdict."""

from collections.abc import Callable, Sequence

from PySide6.QtWidgets import QWidget

from calstation.gui.text import CheckText, check_text, on_language_change, say
from calstation.gui.widgets import theme
from calstation.gui.widgets.layout import column
from calstation.gui.widgets.parameter_table import Column, ParameterModel, ParameterTable
from calstation.judgement import Check

_ROW = 28
_ORDER = {"bad": 0, "caution": 1, "good": 2}


class ChecksTable(QWidget):
    """Lists failed checks first, then near misses, then the others, each group in the order of the result."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._checks: Sequence[Check] = ()
        self._texts: dict[str, CheckText] = {}
        self.model = ParameterModel(
            (
                Column("common.check", self._cell("sentence"), number=False),
                Column("common.where", self._cell("where"), number=False),
                Column("common.unit", self._cell("unit"), number=False),
                Column("common.value", self._cell("value")),
                Column("common.limit", self._cell("limit")),
                Column("common.margin", self._cell("margin")),
                Column("common.verdict", self._cell("verdict"), number=False, state=self._state),
            ),
            grouped=False,
        )
        self.table = ParameterTable(self.model)
        self.table.setObjectName("checks_table")
        self.table.verticalHeader().hide()
        self.table.verticalHeader().setDefaultSectionSize(_ROW)
        column(self.table, on=self)
        on_language_change(self, self._refresh)

    def show_checks(self, checks: Sequence[Check]) -> None:
        """Show these checks."""
        self._checks = sorted(checks, key=lambda check: _ORDER[check_text(check).state])
        self._update_texts()
        self.model.set_names([str(k) for k in range(len(checks))])

    def height_of_rows(self) -> int:
        """Return the height at which all rows are visible, px."""
        return self.table.horizontalHeader().sizeHint().height() + _ROW * len(self._checks) + theme.GRID

    def _refresh(self) -> None:
        self.table.setAccessibleName(say("common.checks_of_result"))
        self._update_texts()
        self.model.refresh()

    def _update_texts(self) -> None:
        self._texts = {str(k): check_text(check) for k, check in enumerate(self._checks)}

    def _cell(self, field: str) -> Callable[[str], str]:
        return lambda row: str(getattr(self._texts[row], field))

    def _state(self, row: str) -> str:
        return self._texts[row].state
