"""The methods that need no rate table, and the tab bar that selects one of them."""

from functools import partial

from PySide6.QtCore import Signal

from calstation.gui.text import bind
from calstation.gui.widgets import ViewTabs

MULTI_POSITION, GIMBAL, CROSS_CALIBRATION = "multi_position", "gimbal", "cross_calibration"
#: Stage names of the methods, in the order of the tabs.
STAGES = (MULTI_POSITION, GIMBAL, CROSS_CALIBRATION)

#: The kind of recording (`simulation.Kind`) that each method solves.
RECORDED_AS = {MULTI_POSITION: "hand", GIMBAL: "gimbal", CROSS_CALIBRATION: "pair"}


class MethodBar(ViewTabs):
    """Tabs for the stages of the log ("") and for each method; emits `chosen(method)` when another is selected."""

    chosen = Signal(str)

    def __init__(self) -> None:
        super().__init__("method_tabs", "logs.stages_of_log", *(f"stage.{stage}" for stage in STAGES))
        tips = "logs.solve_stages_tip", *(f"method.{stage}_summary" for stage in STAGES)
        for index, tip in enumerate(tips):
            bind(partial(self.setTabToolTip, index), tip)
        self.currentChanged.connect(lambda _: self.chosen.emit(self.chosen_method))

    @property
    def chosen_method(self) -> str:
        """The selected method; "" for the stages."""
        return ("", *STAGES)[self.currentIndex()]

    def choose(self, method: str) -> None:
        """Select a method as if its tab were clicked."""
        self.setCurrentIndex(("", *STAGES).index(method))
