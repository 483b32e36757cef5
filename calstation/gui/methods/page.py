"""The methods page: three methods as cards, and beside them the one chosen with its guidance, work and pictures."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QHBoxLayout, QStackedWidget

from calstation.gui import theme
from calstation.gui.context import AppContext
from calstation.gui.methods.cards import MethodCards
from calstation.gui.methods.kinds import STAGES
from calstation.gui.methods.panel import MethodPanel
from calstation.gui.page import Page


class MethodsPage(Page):
    """`live_wanted()`: the operator page is to guide by hand now."""

    live_wanted = Signal()

    def __init__(self, app: AppContext) -> None:
        super().__init__(app)
        self.setObjectName("methods_page")
        self.cards = MethodCards()
        self.panels = {stage: MethodPanel(app, stage) for stage in STAGES}
        self._stack = QStackedWidget()
        for panel in self.panels.values():
            panel.live_wanted.connect(self.live_wanted)
            self._stack.addWidget(panel)
        self.cards.chosen.connect(lambda stage: self._stack.setCurrentWidget(self.panels[stage]))
        row = QHBoxLayout(self)
        row.setContentsMargins(2 * theme.GRID, theme.GRID, 2 * theme.GRID, 2 * theme.GRID)
        row.setSpacing(2 * theme.GRID)
        row.addWidget(self.cards)
        row.addWidget(self._stack, 1)
        opener = QShortcut(QKeySequence.StandardKey.Open, self, lambda: self.panel.source.look())
        opener.setContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)

    @property
    def panel(self) -> MethodPanel:
        """The panel of the method chosen."""
        return self.panels[STAGES[self._stack.currentIndex()]]

    def choose(self, stage: str) -> None:
        """Choose a method as a click on its card does."""
        self.cards.cards[stage].click()

    def title(self) -> str:
        """The page's name on its tab."""
        return self.tr("Methods")
