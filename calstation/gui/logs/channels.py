"""The channels of a log, and the button whose menu shows and hides them."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QMenu, QPushButton

from calstation.gui.text import bind, on_language_change, say
from calstation.results.plots import CHANNELS

#: Channels of each plot, and the unit and decimals of their values.
PLOTS = (
    (CHANNELS[:3], "°/s", 5),
    (CHANNELS[3:6], "m/s²", 5),
    (CHANNELS[6:8], "°", 4),
    (CHANNELS[8:], "°C", 3),
)


class ChannelButton(QPushButton):
    """Offers the channels of a log in a menu; emits `changed(shown)` with the set of ticked channels."""

    changed = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("channels_button")
        self._present: tuple[str, ...] = ()
        self._hidden: set[str] = set()
        self._menu = QMenu(self)
        self.setMenu(self._menu)
        bind(self, "logs.channels")
        bind(self.setToolTip, "logs.channels_tip")
        on_language_change(self, self._fill)

    def show_channels(self, present: tuple[str, ...]) -> None:
        """Offer the channels of another log, all ticked."""
        self._present, self._hidden = present, set()
        self._fill()
        self.changed.emit(set(present))

    def _fill(self) -> None:
        self._menu.clear()
        for channels, _, _ in PLOTS:
            for channel in filter(self._present.__contains__, channels):
                sensor, _, axis = channel.partition("_")
                action = self._menu.addAction(say(f"logs.channel_{sensor}", axis=axis))
                action.setCheckable(True)
                action.setChecked(channel not in self._hidden)
                action.toggled.connect(lambda _, channel=channel: self._toggle(channel))
            self._menu.addSeparator()

    def _toggle(self, channel: str) -> None:
        self._hidden ^= {channel}
        self.changed.emit(set(self._present) - self._hidden)
