"""The methods page: three methods as cards, and beside them the one chosen with its guidance, work and pictures."""

from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeySequence, QShortcut, QShowEvent
from PySide6.QtWidgets import QHBoxLayout, QStackedWidget

from calstation.gui.logs.methods.cards import MethodCards
from calstation.gui.logs.methods.kinds import STAGES
from calstation.gui.shell.context import AppContext
from calstation.gui.shell.page import Page
from calstation.gui.widgets import theme

if TYPE_CHECKING:
    from calstation.gui.logs.methods.panel import MethodPanel


class MethodsPage(Page):
    """`live_wanted()`: the operator page is to guide by hand now."""

    live_wanted = Signal()

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("methods_page")
        self.cards = MethodCards()
        self._panels: dict[str, MethodPanel] = {}
        self._chosen = STAGES[0]
        self._stack = QStackedWidget()
        self.cards.chosen.connect(self._show)
        row = QHBoxLayout(self)
        row.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        row.setSpacing(2 * theme.GRID)
        row.addWidget(self.cards)
        row.addWidget(self._stack, 1)
        opener = QShortcut(QKeySequence.StandardKey.Open, self, lambda: self.panel.source.look())
        opener.setContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)

    @property
    def panel(self) -> "MethodPanel":
        """The panel of the method chosen."""
        return self._show(self._chosen)

    def choose(self, stage: str) -> None:
        """Choose a method as a click on its card does."""
        self.cards.cards[stage].click()

    def showEvent(self, event: QShowEvent) -> None:
        """The first method is made when somebody looks: a window opens sooner without."""
        super().showEvent(event)
        _ = self.panel

    def _show(self, stage: str) -> "MethodPanel":
        """Show a method's panel, made the first time."""
        from calstation.gui.logs.methods.panel import MethodPanel  # its solvers take long to import

        self._chosen = stage
        panel = self._panels.get(stage)
        if panel is None:
            panel = self._panels[stage] = MethodPanel(self.app, stage)
            panel.live_wanted.connect(self.live_wanted)
            self._stack.addWidget(panel)
        self._stack.setCurrentWidget(panel)
        return panel

    def title(self) -> str:
        """The page's name on its tab."""
        return self.tr("Methods")
