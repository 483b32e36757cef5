"""The row above the plot of a log, with a summary and buttons that select channels and zoom the plot."""

from functools import partial

from PySide6.QtCore import QRectF, Signal
from PySide6.QtWidgets import QLabel, QMenu, QPushButton, QWidget

from calstation.gui.logs.log_plot import LogPlot
from calstation.gui.logs.plot_items import PLOTS, draw_symbol
from calstation.gui.logs.range_bar import RangeBar
from calstation.gui.text import bind, duration_text, on_language_change, product_text, say
from calstation.gui.widgets import ElidedLabel, button, label, painted_pixmap, row, theme
from calstation.results.plots import LogIndex


class ChannelButton(QPushButton):
    """A button with a menu of the channels of a log, which emits `changed(channels)` with the ticked channels."""

    changed = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("channels_button")
        self._available: tuple[str, ...] = ()
        self._hidden: set[str] = set()
        self._menu = QMenu(self)
        self.setMenu(self._menu)
        bind(self, "logs.channels")
        bind(self.setToolTip, "logs.channels_tip")
        on_language_change(self, self._fill)

    def show_channels(self, channels: tuple[str, ...]) -> None:
        """Offer the channels of another log, all ticked."""
        self._available, self._hidden = channels, set()
        self._fill()
        self.changed.emit(set(channels))

    def _fill(self) -> None:
        self._menu.clear()
        for channels, _, _ in PLOTS:
            for channel in filter(self._available.__contains__, channels):
                sensor, _, axis = channel.partition("_")
                action = self._menu.addAction(say(f"logs.channel_{sensor}", axis=axis))
                action.setCheckable(True)
                action.setChecked(channel not in self._hidden)
                action.toggled.connect(lambda _, channel=channel: self._toggle(channel))
            self._menu.addSeparator()

    def _toggle(self, channel: str) -> None:
        self._hidden ^= {channel}
        self.changed.emit(set(self._available) - self._hidden)


_SYMBOL_SIZE = 12


class LogHead(QWidget):
    """The summary of a log, and buttons that zoom its plot, also to the range selected in a range bar."""

    def __init__(self, plot: LogPlot, range_bar: RangeBar) -> None:
        super().__init__()
        self._log_index: LogIndex | None = None
        self._summary = ElidedLabel()
        self.channels = ChannelButton()
        self.channels.changed.connect(plot.show_channels)
        self._counts: dict[str, tuple[QLabel, QLabel]] = {
            kind: (label(), label()) for kind in ("gap", "invalid", "paused", "damaged")
        }
        buttons = []
        for name, words, tip, zoom in (
            ("zoom_in_button", "logs.plus", "logs.zoom_in", lambda: plot.zoom(True)),
            ("zoom_out_button", "logs.minus", "logs.zoom_out", lambda: plot.zoom(False)),
            ("zoom_range_button", "logs.range", "logs.show_range", lambda: plot.show_part(*range_bar.range)),
            ("zoom_all_button", "logs.all", "logs.show_log", plot.show_all),
        ):
            buttons.append(button(name, words, zoom, tip=tip))
            bind(buttons[-1].setAccessibleName, tip)
        for each in buttons[:2]:
            each.setFixedWidth(theme.BUTTON)
            each.setStyleSheet("padding: 0")
        counts = [widget for pair in self._counts.values() for widget in pair]
        row((self._summary, 1), *counts, self.channels, *buttons, on=self)
        theme.on_appearance_change(self, self._refresh)

    def show_log(self, log_index: LogIndex) -> None:
        """Show the summary of another log."""
        self._log_index = log_index
        self.channels.show_channels(log_index.channels)
        self._refresh()

    def _refresh(self) -> None:
        log = self._log_index
        if log is None:
            return
        number = f"{log.facts.samples:,}".replace(",", " ")
        samples = say("logs.samples_and_rate", samples=number, rate=log.rate)
        parts = [log.meta.imu.serial, duration_text(log.facts.samples / log.rate), samples]
        if log.meta.product is not None:  # the name is last, because a long line is elided
            parts.append(product_text(log.meta.product.name))
        self._summary.setText("  ·  ".join(parts))
        symbol_box = QRectF(0, 0, _SYMBOL_SIZE, _SYMBOL_SIZE)
        paused = duration_text(log.paused_samples / log.rate)
        for kind, count, words in (
            ("gap", log.gaps.count, say("logs.gaps", count=log.gaps.count)),
            ("invalid", log.invalid_samples, say("logs.invalid_samples", count=log.invalid_samples)),
            ("paused", log.paused_samples, say("logs.paused_time", duration=paused)),
            ("damaged", log.facts.damaged, say("logs.damaged_rows", count=log.facts.damaged)),
        ):
            icon, text = self._counts[kind]
            icon.setPixmap(painted_pixmap(_SYMBOL_SIZE, partial(draw_symbol, kind=kind, box=symbol_box)))
            text.setText(words)
            icon.setVisible(count > 0)
            text.setVisible(count > 0)
