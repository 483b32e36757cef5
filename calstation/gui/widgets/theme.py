"""Appearance of the window: light and dark colours, sizes on an 8 px grid, fonts, and a style sheet."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from string import Template

from PySide6.QtCore import QObject, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QFont, QFontDatabase, QGuiApplication, QPainter, QPalette, QPen
from PySide6.QtWidgets import QApplication, QWidget

from calstation.config import library
from calstation.gui.text import on_language_change

#: Grid of margins and distances, px.
GRID = 8

#: Text sizes, px.
BODY, SECTION, VERDICT = 14, 18, 72

#: Minimum height of a button, and of START and STOP, px.
BUTTON, BIG_BUTTON = 44, 64

#: Height of the tab bar, px.
TOP_BAR = 56

#: Sizes in the style sheet, px.
_SIZES = {
    "input_height": BUTTON - 2 * GRID,
    "half_grid": GRID // 2,
    "button_inside": BUTTON - 2,
    "padding": 2 * GRID,
    "padding_focus": 2 * GRID - 1,
    "padding_primary": 2 * GRID - 2,
    "big_button_inside": BIG_BUTTON - 2,
    "section": SECTION,
    "button": BUTTON,
    "grid": GRID,
    "heading": 3 * GRID,
    "check_box": 5 * GRID // 2,
    "check_box_inside": 5 * GRID // 2 - 2,
    "tab": TOP_BAR - 3,
    "tab_padding": 5 * GRID // 4,
    "body": BODY,
    "view_tab": BUTTON - 3,
}
_STYLE_SHEET = Path(__file__).with_suffix(".qss")

#: Colours of x, y and z in both themes, which colour-blind viewers can distinguish.
AXIS_COLOURS = {"x": "#0072B2", "y": "#D55E00", "z": "#009E73"}

#: Colours of the letters x, y and z in the light and the dark theme, darker or brighter than the axis colours, because
#: letters need more contrast than lines.
_AXIS_TEXT = {"x": ("#0072B2", "#4DA3D9"), "y": ("#A84A00", "#E8741A"), "z": ("#007A59", "#10B284")}

#: The shipped font; Qt uses system fonts for characters that this font lacks.
FAMILY = "Calstation Sans"


@dataclass(frozen=True)
class Colours:
    """Colours of a theme as ``#rrggbb``; `line` is for lines and borders, `track` for fills without a meaning."""

    window: str
    panel: str
    field: str
    text: str
    muted: str
    line: str
    track: str
    accent: str
    on_accent: str
    good: str
    bad: str
    alarm: str
    caution: str
    partial: str
    on_state: str
    on_alarm: str


#: The light and the dark colour of each role.
_ROLES = {
    "window": ("#eceff1", "#12171b"),
    "panel": ("#ffffff", "#1b2228"),
    "field": ("#ffffff", "#232c33"),
    "text": ("#14191d", "#e7ecef"),
    "muted": ("#55616a", "#9caab4"),
    "line": ("#7d8a93", "#6b7c86"),
    "track": ("#c3ccd2", "#3a4750"),
    "accent": ("#1f5f8b", "#6cb2e2"),
    "on_accent": ("#ffffff", "#0d1317"),
    "good": ("#1b7a43", "#4cc38a"),
    "bad": ("#b3261e", "#ff7a6e"),
    "alarm": ("#b3261e", "#d32f2f"),  # STOP and FAIL are filled with it, and are red in both themes
    "caution": ("#8a5a00", "#f0b940"),
    "partial": ("#6a3fa0", "#c0a2f2"),
    "on_state": ("#ffffff", "#0d1317"),
    "on_alarm": ("#ffffff", "#ffffff"),
}

#: Colours by theme name.
COLOURS = {
    name: Colours(**{role: both[index] for role, both in _ROLES.items()})
    for index, name in enumerate(("light", "dark"))
}

_current = "light"


class _Themes(QObject):
    changed = Signal()


#: Emits `changed` after another theme has been applied.
themes = _Themes()


def colours() -> Colours:
    """Return the colours of the current theme."""
    return COLOURS[_current]


def axis_text(axis: str) -> str:
    """Return the colour of the letter x, y or z in the current theme."""
    return _AXIS_TEXT[axis][_current == "dark"]


def current() -> str:
    """Return the name of the current theme."""
    return _current


def apply(name: str) -> None:
    """Switch the whole application to a theme."""
    global _current
    app = QApplication.instance()
    if not isinstance(app, QApplication):
        raise TypeError("a theme needs a QApplication")
    name = name if name in COLOURS else "light"
    if name == _current and app.styleSheet():
        return  # a new style sheet polishes every widget again, which is slow
    _current = name
    app.setPalette(palette(colours()))
    fonts = [
        (widget, widget.font()) for widget in app.allWidgets() if widget.testAttribute(Qt.WidgetAttribute.WA_SetFont)
    ]
    app.setStyleSheet(style_sheet(colours()))
    for widget, before in fonts:
        if widget.font() != before:  # a new style sheet resets the fonts of some widgets
            widget.setFont(before)
    themes.changed.emit()


def on_appearance_change(owner: QObject, show: Callable[[], object]) -> None:
    """Call `show`, a method of `owner`, now and after each change of language or theme."""
    themes.changed.connect(show)
    on_language_change(owner, show)


def pen(colour: str | QColor, width: float = 1.0, style: Qt.PenStyle = Qt.PenStyle.SolidLine) -> QPen:
    """Return a pen for plots with a width in logical px, because Qt does not scale the widths of cosmetic pens."""
    made = QPen(QColor(colour), width * QGuiApplication.primaryScreen().devicePixelRatio(), style)
    made.setCosmetic(True)
    return made


def faint(colour: str, alpha: int) -> QColor:
    """Return a colour with the opacity `alpha` from 0 to 255."""
    result = QColor(colour)
    result.setAlpha(alpha)
    return result


def palette(c: Colours) -> QPalette:
    """Return the Qt palette of a theme."""
    result = QPalette()
    for colour, roles in (
        (c.window, "Window"),
        (c.field, "Base"),
        (c.panel, "AlternateBase Button ToolTipBase Light"),
        (c.text, "WindowText Text ButtonText ToolTipText"),
        (c.muted, "PlaceholderText Dark"),
        (c.bad, "BrightText"),
        (c.accent, "Highlight Accent Link LinkVisited"),
        (c.on_accent, "HighlightedText"),
        (c.line, "Midlight Mid Shadow"),
    ):
        for role in roles.split():
            result.setColor(QPalette.ColorRole[role], QColor(colour))
    disabled = (
        (c.muted, "WindowText Text ButtonText"),
        (c.window, "Base Button"),
        (c.track, "Highlight"),
        (c.text, "HighlightedText"),
    )
    for colour, roles in disabled:
        for role in roles.split():
            result.setColor(QPalette.ColorGroup.Disabled, QPalette.ColorRole[role], QColor(colour))
    return result


def style_sheet(c: Colours) -> str:
    """Return the style sheet that sets heights, borders and fills, which a palette cannot set."""
    return Template(_STYLE_SHEET.read_text(encoding="utf-8")).substitute(_SIZES, **vars(c))


def font(size: int = BODY, *, bold: bool = False) -> QFont:
    """Return the font of the window with a size in px and digits of equal width."""
    return QFont(_font(size, bold))


@cache
def _font(size: int, bold: bool) -> QFont:
    _load_font()
    result = QFont(FAMILY)
    result.setPixelSize(size)
    if bold:
        result.setWeight(QFont.Weight.DemiBold)
    return result


@cache
def _load_font() -> None:
    for file in library.fonts_folder().glob("*.otf"):
        QFontDatabase.addApplicationFont(str(file))


def painter(widget: QWidget) -> QPainter:
    """Return a painter that draws smooth lines on a widget."""
    result = QPainter(widget)
    result.setRenderHint(QPainter.RenderHint.Antialiasing)
    return result


def set_kind(widget: QWidget, kind: str) -> None:
    """Set the kind of a widget, such as primary, panel or muted, by which the style sheet selects its style."""
    widget.setProperty("kind", kind)
    widget.style().unpolish(widget)
    widget.style().polish(widget)


def set_invalid(widget: QWidget, *, invalid: bool) -> None:
    """Draw the border of an input in red while its text is wrong."""
    if widget.property("invalid") != invalid:
        widget.setProperty("invalid", invalid)
        widget.style().unpolish(widget)
        widget.style().polish(widget)
        widget.update()


def paint_invalid_border(widget: QWidget) -> None:
    """Paint the red border of a wrong spin box or combo box, whose parts a border in the style sheet would displace."""
    if widget.property("invalid"):
        made = painter(widget)
        made.setPen(QPen(QColor(colours().bad), 2))
        made.drawRoundedRect(QRectF(widget.rect()).adjusted(1, 1, -1, -1), GRID // 2, GRID // 2)
