"""A one-line summary of a log, and the buttons that select the channels of its plot and zoom it."""

from functools import partial

from PySide6.QtCore import QRectF, Signal
from PySide6.QtWidgets import QLabel, QMenu, QPushButton, QWidget

from calstation.gui.logs.log_plot import LogPlot
from calstation.gui.logs.plot_items import PLOTS, draw_sign
from calstation.gui.logs.range_bar import RangeBar
from calstation.gui.text import Words, bind, duration_text, on_language_change, product_text, say
from calstation.gui.widgets import ElidedLabel, button, label, painted_pixmap, row, theme
from calstation.results.plots import LogIndex


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


_SIGN = 12


class LogHead(QWidget):
    """Summarises a log and zooms its plot, also to the range selected in a range bar."""

    def __init__(self, plot: LogPlot, chosen: RangeBar) -> None:
        super().__init__()
        self._log_index: LogIndex | None = None
        self._facts = ElidedLabel()
        self.channels = ChannelButton()
        self.channels.changed.connect(plot.show_channels)
        self._signs: dict[str, tuple[QLabel, QLabel]] = {k: (label(), label()) for k in ("gap", "spoilt", "damaged")}
        tips: tuple[Words, ...] = ("logs.zoom_in", "logs.zoom_out", "logs.show_range", "logs.show_log")
        buttons: tuple[QPushButton, ...] = (
            button("zoom_in_button", "logs.plus", lambda: plot.zoom(True)),
            button("zoom_out_button", "logs.minus", lambda: plot.zoom(False)),
            button("zoom_range_button", "logs.range", lambda: plot.show_part(*chosen.range)),
            button("zoom_all_button", "logs.all", plot.whole),
        )
        for made, tip in zip(buttons, tips, strict=True):
            bind(made.setToolTip, tip)
            bind(made.setAccessibleName, tip)
        for made in buttons[:2]:
            made.setFixedWidth(theme.BUTTON)
            made.setStyleSheet("padding: 0")
        signs = [widget for pair in self._signs.values() for widget in pair]
        row((self._facts, 1), *signs, self.channels, *buttons, on=self)
        theme.on_appearance_change(self, self._refresh)

    def show_log(self, log_index: LogIndex) -> None:
        """Show another log."""
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
        if log.meta.product is not None:  # last, because an overlong line is elided at its end
            parts.append(product_text(log.meta.product.name))
        self._facts.setText("  ·  ".join(parts))
        for kind, count, code in (
            ("gap", log.gaps.count, "logs.gaps"),
            ("spoilt", log.invalid_samples, "logs.invalid_samples"),
            ("damaged", log.facts.damaged, "logs.damaged_rows"),
        ):
            icon, text = self._signs[kind]
            icon.setPixmap(painted_pixmap(_SIGN, partial(draw_sign, kind=kind, box=QRectF(0, 0, _SIGN, _SIGN))))
            text.setText(say(code, count=count))
            icon.setVisible(count > 0)
            text.setVisible(count > 0)
