"""The three methods in words: what each is for, how it is done, what it needs and what it finds."""

from dataclasses import dataclass

from PySide6.QtCore import QCoreApplication, Signal
from PySide6.QtWidgets import QTabBar, QWidget

from calstation.gui.text import on_language_change

MULTI_POSITION, GIMBAL, CROSS_CALIBRATION = "multi_position", "gimbal", "cross_calibration"
#: The methods by the names of their stages, in the page's order.
STAGES = (MULTI_POSITION, GIMBAL, CROSS_CALIBRATION)

#: The kind of recording (`station.bench_recordings.Kind`) that each of them solves.
RECORDED_AS = {MULTI_POSITION: "hand", GIMBAL: "gimbal", CROSS_CALIBRATION: "pair"}


@dataclass(frozen=True)
class MethodWords:
    """A method in the language in force; steps : in order, one sentence or two each."""

    title: str
    summary: str
    steps: tuple[str, ...]
    needs: str
    finds: str


def words(stage: str) -> MethodWords:
    """A method's words."""
    return {MULTI_POSITION: _positions, GIMBAL: _gimbal, CROSS_CALIBRATION: _pair}[stage]()


def _positions() -> MethodWords:
    return MethodWords(
        QCoreApplication.translate("methods", "Multi-position"),
        QCoreApplication.translate("methods", "Gyros and accelerometers on a simple rig, or by hand"),
        (
            QCoreApplication.translate(
                "methods", "Fix the unit to the inner rail, level, and let it rest for half a minute."
            ),
            QCoreApplication.translate(
                "methods",
                "Carry it round on the inner rail and back. Let go at every position for some seconds; "
                "no angle has to be exact.",
            ),
            QCoreApplication.translate(
                "methods",
                "Do the same on the outer rail, and once more with the inner rail a quarter turn on.",
            ),
            QCoreApplication.translate(
                "methods",
                "Rests and motions are found in the recording itself: at rest the force is as long as gravity, "
                "and a motion turns by as much as gravity's direction did.",
            ),
        ),
        QCoreApplication.translate(
            "methods",
            "A recording of gyros and accelerometers with a dozen rests or more in well spread positions. "
            "No table, no angles.",
        ),
        QCoreApplication.translate(
            "methods",
            "Bias, scale factor and misalignment of gyros and accelerometers, each with its sigma.",
        ),
    )


def _gimbal() -> MethodWords:
    return MethodWords(
        QCoreApplication.translate("methods", "Gimbal"),
        QCoreApplication.translate("methods", "Gyro misalignment from the gimbal's own joints"),
        (
            QCoreApplication.translate("methods", "Hold all joints at zero: what the gyros show there is their bias."),
            QCoreApplication.translate(
                "methods",
                "Turn one axis by a set angle, while the gimbal stabilises the other two on the unit's "
                "corrected rates.",
            ),
            QCoreApplication.translate(
                "methods",
                "The other two joints drift by D, because the gyro axes are not square. D times the gain α "
                "corrects the matrix K.",
            ),
            QCoreApplication.translate(
                "methods",
                "Back to zero, and again until D is below its threshold. Then the next axis.",
            ),
        ),
        QCoreApplication.translate(
            "methods",
            "A gimbal that stabilises on corrected rates, and a recording with its joint angles "
            "(joint_x_deg, joint_y_deg, joint_z_deg).",
        ),
        QCoreApplication.translate(
            "methods",
            "The six gyro misalignments; how fast each axis converged, the stable range of the gain, and the "
            "least-squares answer beside them.",
        ),
    )


def _pair() -> MethodWords:
    return MethodWords(
        QCoreApplication.translate("methods", "Cross-calibration"),
        QCoreApplication.translate("methods", "A secondary IMU against the primary on the same body"),
        (
            QCoreApplication.translate("methods", "Fix all IMUs to one body and record them in the same rows."),
            QCoreApplication.translate(
                "methods",
                "Let the body rest. Every sensor is checked there against its threshold: the secondary's and "
                "the primary's own.",
            ),
            QCoreApplication.translate(
                "methods",
                "Where a secondary is off and the primary is not, turn and tilt the body about all axes until "
                "enough motion is collected.",
            ),
            QCoreApplication.translate(
                "methods",
                "The errors that are found replace those kept before. Later data are compensated with them, and "
                "then with the primary's own errors.",
            ),
        ),
        QCoreApplication.translate(
            "methods",
            "Two IMUs or more, one row per sample (gyro2_x … accel2_z and [imu2]). The primary has been "
            "calibrated before.",
        ),
        QCoreApplication.translate(
            "methods",
            "Bias and matrix of the secondary's gyros and accelerometers, its lever arm and its clock offset.",
        ),
    )


class MethodBar(QTabBar):
    """Tabs of the stages ("") and of each method. `chosen(method)`: another one was chosen."""

    chosen = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("method_tabs")
        self.setProperty("kind", "views")
        self.setDrawBase(False)
        self.setExpanding(False)
        for _ in ("", *STAGES):
            self.addTab("")
        self.currentChanged.connect(lambda _: self.chosen.emit(self.chosen_method))
        on_language_change(self, self._show_texts)

    @property
    def chosen_method(self) -> str:
        """The chosen method; "" for the stages."""
        return ("", *STAGES)[self.currentIndex()]

    def choose(self, method: str) -> None:
        """Choose a method as a click on its tab does."""
        self.setCurrentIndex(("", *STAGES).index(method))

    def _show_texts(self) -> None:
        self.setTabText(0, self.tr("Stages of the log"))
        self.setTabToolTip(0, self.tr("Solve the stages again as they were recorded"))
        for index, stage in enumerate(STAGES, start=1):
            self.setTabText(index, words(stage).title)
            self.setTabToolTip(index, words(stage).summary)
