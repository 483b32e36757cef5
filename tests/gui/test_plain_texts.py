"""Labels and tooltips show foreign text as it is."""

from PySide6.QtCore import Qt
from PySide6.QtGui import QTextDocument
from pytestqt.qtbot import QtBot

from calstation.gui.widgets import ElidedLabel, label, plain_tip
from calstation.gui.widgets.layout import PlainLabel


def test_labels_and_tooltips_show_plain_text(qtbot: QtBot) -> None:
    widgets = (label(), PlainLabel("<b>x</b>"), ElidedLabel())
    for widget in widgets:
        qtbot.addWidget(widget)
        assert widget.textFormat() == Qt.TextFormat.PlainText
    elided = widgets[-1]
    elided.setText("<b>x</b>")
    for tip in (elided.toolTip(), plain_tip("<b>x</b>")):
        document = QTextDocument()
        document.setHtml(tip)
        assert document.toPlainText() == "<b>x</b>"
    assert plain_tip("a < b\nc") == "a < b\nc"
