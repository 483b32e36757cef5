"""The methods that need no rate table, and the tab bar that selects one of them."""

from PySide6.QtCore import Signal

from calstation.gui.text import on_language_change, term
from calstation.gui.widgets import ViewTabs

MULTI_POSITION, GIMBAL, CROSS_CALIBRATION = "multi_position", "gimbal", "cross_calibration"
#: Stage names of the methods, in the order of the tabs.
STAGES = (MULTI_POSITION, GIMBAL, CROSS_CALIBRATION)

#: The kind of recording (`simulation.recordings.Kind`) that each method solves.
RECORDED_AS = {MULTI_POSITION: "hand", GIMBAL: "gimbal", CROSS_CALIBRATION: "pair"}


class MethodBar(ViewTabs):
    """Tabs for the stages of the log ("") and for each method; emits `chosen(method)` when another is selected."""

    chosen = Signal(str)

    def __init__(self) -> None:
        super().__init__("method_tabs")
        for _ in ("", *STAGES):
            self.addTab("")
        self.currentChanged.connect(lambda _: self.chosen.emit(self.chosen_method))
        on_language_change(self, self._show_texts)

    @property
    def chosen_method(self) -> str:
        """The selected method; "" for the stages."""
        return ("", *STAGES)[self.currentIndex()]

    def choose(self, method: str) -> None:
        """Select a method as if its tab were clicked."""
        self.setCurrentIndex(("", *STAGES).index(method))

    def _show_texts(self) -> None:
        self.setTabText(0, self.tr("Stages of the log"))
        self.setTabToolTip(0, self.tr("Solve the stages again as they were recorded"))
        for index, stage in enumerate(STAGES, start=1):
            self.setTabText(index, term("stage", stage))
            self.setTabToolTip(index, term("method", f"{stage}_summary"))
