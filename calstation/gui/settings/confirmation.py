"""That a person says at this computer: the station stands where its file says."""

from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QLabel, QPushButton, QVBoxLayout, QWidget

from calstation.config.editing import Place
from calstation.config.site_check import this_computer, vouching
from calstation.config.station import StationConfig
from calstation.gui.settings.draft import Draft
from calstation.gui.widgets import theme

_CONFIRMED: Place = ("site", "confirmed_on")


class PlaceConfirmation(QWidget):
    """At which computers the place was confirmed, and the button that does it here; nothing on a virtual bench."""

    def __init__(self, draft: Draft) -> None:
        super().__init__()
        self._draft = draft
        self._text = QLabel()
        self._text.setObjectName("site_confirmed_on_message")
        self._text.setWordWrap(True)
        self.button = QPushButton()
        self.button.setObjectName("confirm_place_button")
        self.button.clicked.connect(self._confirm)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, theme.GRID, 0, 0)
        column.setSpacing(theme.GRID)
        column.addWidget(self._text)
        column.addWidget(self.button, 0, Qt.AlignmentFlag.AlignLeft)
        draft.changed.connect(self.refresh)
        self.retranslate()

    def lock(self, reason: str) -> None:
        """Forbid confirming, with the reason as tooltip; "" allows it."""
        self.button.setEnabled(not reason)
        self.button.setToolTip(reason)

    def refresh(self) -> None:
        """Show who has vouched for the place as the draft has it."""
        self.setVisible(self._draft.value(("bench",)) is None)
        told, here, wanted = self._told(), this_computer(), self._wanted()
        self.button.setVisible(bool(wanted) and wanted not in told)
        kind = "muted"
        if wanted in told:
            text = self.tr("✓ This place was confirmed at this computer ({0}).").format(here)
        elif told:
            kind = "caution"
            text = self.tr(
                "Confirmed was “{0}”, not this place at this computer ({1}): no run starts. Make sure of latitude, "
                "height and gravity, then confirm it."
            ).format("; ".join(told), here)
        else:
            text = self.tr(
                "Nobody has confirmed this place at this computer ({0}) yet. Units whose gyros do not feel the earth "
                "turn are calibrated only where somebody has; and a file that was confirmed is refused when it is "
                "taken to another computer."
            ).format(here)
        self._text.setText(text)
        if self._text.property("kind") != kind:
            theme.set_kind(self._text, kind)

    def retranslate(self) -> None:
        """Say everything again in the language in force."""
        self.button.setText(self.tr("The station stands here"))
        self.refresh()

    def changeEvent(self, event: QEvent) -> None:
        """Hear of a new language."""
        if event.type() == QEvent.Type.LanguageChange:
            self.retranslate()
        super().changeEvent(event)

    def _told(self) -> list[str]:
        value = self._draft.value(_CONFIRMED)
        return [str(name) for name in value] if isinstance(value, list) else []

    def _wanted(self) -> str:
        """What a confirmation here would say, "" while something is wrong with the file."""
        station = self._draft.model
        return vouching(station.site) if isinstance(station, StationConfig) else ""

    def _confirm(self) -> None:
        here = f"{this_computer()}: "
        others = [entry for entry in self._told() if not entry.startswith(here)]
        self._draft.set({_CONFIRMED: [*others, self._wanted()]})
