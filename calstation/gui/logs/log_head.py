"""A one-line summary of a log, and the buttons that select the channels of its plot and zoom it."""

from functools import partial

from PySide6.QtCore import QRectF
from PySide6.QtWidgets import QLabel, QPushButton, QWidget

from calstation.gui.logs.channels import ChannelButton
from calstation.gui.logs.log_plot import LogPlot
from calstation.gui.logs.marks import draw_sign
from calstation.gui.logs.range_bar import RangeBar
from calstation.gui.text import bind, duration_text, product_text
from calstation.gui.widgets import ElidedLabel, Words, button, label, painted_pixmap, row, theme
from calstation.results.plots import LogIndex

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
        tips: tuple[Words, ...] = (
            lambda: self.tr("Closer (+)"),
            lambda: self.tr("Further away (−)"),
            lambda: self.tr("Bring the chosen range into view"),
            lambda: self.tr("Bring the whole log into view (Home, or a double click)"),
        )
        buttons: tuple[QPushButton, ...] = (
            button("zoom_in_button", lambda: "+", lambda: plot.zoom(True)),
            button("zoom_out_button", lambda: "−", lambda: plot.zoom(False)),
            button("zoom_range_button", lambda: self.tr("Range"), lambda: plot.show_part(*chosen.range)),
            button("zoom_all_button", lambda: self.tr("All"), plot.whole),
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
        samples = self.tr("{0} samples, {1} Hz").format(f"{log.facts.samples:,}".replace(",", " "), f"{log.rate:g}")
        parts = [log.meta.imu.serial, duration_text(log.facts.samples / log.rate), samples]
        if log.meta.product is not None:  # last, because an overlong line is elided at its end
            parts.append(product_text(log.meta.product.name))
        self._facts.setText("  ·  ".join(parts))
        for kind, count, words in (
            ("gap", log.gaps.count, self.tr("gaps: {0}")),
            ("spoilt", log.spoilt_samples, self.tr("invalid samples: {0}")),
            ("damaged", log.facts.damaged, self.tr("damaged rows: {0}")),
        ):
            icon, text = self._signs[kind]
            icon.setPixmap(painted_pixmap(_SIGN, partial(draw_sign, kind=kind, box=QRectF(0, 0, _SIGN, _SIGN))))
            text.setText(words.format(count))
            icon.setVisible(count > 0)
            text.setVisible(count > 0)
