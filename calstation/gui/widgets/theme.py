"""Appearance of the window: light and dark palette, sizes on an 8 px grid, axis colours, style sheet."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QColor, QFont, QFontDatabase, QPainter, QPalette
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

#: Colours of x, y and z in both themes, safe for colour-blind viewers.
AXIS_COLOURS = {"x": "#0072B2", "y": "#D55E00", "z": "#009E73"}

#: Colours of the letters x, y and z in the light and the dark theme, darker or brighter than the axis colours, because
#: letters need more contrast than lines.
_AXIS_TEXT = {"x": ("#0072B2", "#4DA3D9"), "y": ("#A84A00", "#E8741A"), "z": ("#007A59", "#10B284")}

#: The shipped font. Qt takes characters that it lacks from the fonts of the system.
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
    caution: str
    partial: str
    on_state: str


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
    "caution": ("#8a5a00", "#f0b940"),
    "partial": ("#6a3fa0", "#c0a2f2"),
    "on_state": ("#ffffff", "#0d1317"),
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
    assert isinstance(app, QApplication)
    name = name if name in COLOURS else "light"
    if name == _current and app.styleSheet():
        return  # a new style sheet polishes every widget again, which is slow
    _current = name
    app.setPalette(palette(colours()))
    app.setStyleSheet(style_sheet(colours()))
    themes.changed.emit()


def on_appearance_change(owner: QObject, show: Callable[[], object]) -> None:
    """Call `show`, a method of `owner`, now and after each change of language or theme."""
    themes.changed.connect(show)
    on_language_change(owner, show)


def faint(colour: str, alpha: int) -> QColor:
    """Return a colour with an opacity `alpha` of 0..255."""
    made = QColor(colour)
    made.setAlpha(alpha)
    return made


def palette(c: Colours) -> QPalette:
    """Return the Qt palette of a theme."""
    made = QPalette()
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
            made.setColor(QPalette.ColorRole[role], QColor(colour))
    disabled = (
        (c.muted, "WindowText Text ButtonText"),
        (c.window, "Base Button"),
        (c.track, "Highlight"),
        (c.text, "HighlightedText"),
    )
    for colour, roles in disabled:
        for role in roles.split():
            made.setColor(QPalette.ColorGroup.Disabled, QPalette.ColorRole[role], QColor(colour))
    return made


def style_sheet(c: Colours) -> str:
    """Return the style sheet that sets heights, borders and fills, which a palette cannot set."""
    return f"""
    QComboBox, QLineEdit, QSpinBox, QDoubleSpinBox, QDateEdit {{ min-height: {BUTTON - 2 * GRID}px; }}
    QLineEdit {{
        border: 1px solid {c.line}; border-radius: 4px; background: {c.field}; padding: 0 {GRID // 2}px;
    }}
    QLineEdit:focus {{ border: 2px solid {c.accent}; padding: 0 3px; }}
    QLineEdit:disabled {{ background: {c.window}; color: {c.muted}; }}
    QComboBox QLineEdit, QAbstractSpinBox QLineEdit {{ border: none; background: transparent; padding: 0; }}
    QLineEdit[kind="tall"], QComboBox[kind="tall"] {{
        min-height: {BUTTON - 2}px; max-height: {BUTTON - 2}px;
    }}
    QPushButton {{
        min-height: {BUTTON - 2}px; padding: 0 {2 * GRID}px; border: 1px solid {c.line}; border-radius: 4px;
        background: {c.panel};
    }}
    QPushButton:hover {{ border-color: {c.accent}; }}
    QPushButton:pressed {{ background: {c.track}; }}
    QPushButton:focus {{ border: 2px solid {c.accent}; padding: 0 {2 * GRID - 1}px; }}
    QPushButton:disabled {{ background: {c.window}; color: {c.muted}; }}
    QPushButton:checked {{ background: {c.accent}; color: {c.on_accent}; }}
    QPushButton[kind="primary"] {{ background: {c.accent}; color: {c.on_accent}; border-color: {c.accent}; }}
    QPushButton[kind="primary"]:focus {{ border: 3px solid {c.text}; padding: 0 {2 * GRID - 2}px; }}
    QPushButton[kind="primary"]:disabled {{ background: {c.window}; color: {c.muted}; border-color: {c.line}; }}
    QPushButton[kind="partial"] {{ background: {c.partial}; color: {c.on_state}; border-color: {c.partial}; }}
    QPushButton[kind="partial"]:focus {{ border: 3px solid {c.text}; padding: 0 {2 * GRID - 2}px; }}
    QPushButton[kind="partial"]:disabled {{ background: {c.window}; color: {c.muted}; border-color: {c.line}; }}
    Tile[kind="tile"] {{ background: {c.panel}; border: 1px solid {c.line}; border-radius: 4px; }}
    Tile[kind="tile_chosen"] {{ background: {c.window}; border: 2px solid {c.accent}; border-radius: 4px; }}
    Tile:hover {{ border-color: {c.accent}; }}
    Tile:focus {{ border: 2px solid {c.text}; }}
    QPushButton#stop_button {{ background: {c.bad}; color: {c.on_state}; border-color: {c.bad}; }}
    QPushButton#stop_button:focus {{ border: 3px solid {c.text}; padding: 0 {2 * GRID - 2}px; }}
    QPushButton#start_button, QPushButton#stop_button, QPushButton#pause_button {{
        min-height: {BIG_BUTTON - 2}px; font-size: {SECTION}px; font-weight: 600;
    }}
    QFrame[kind="panel"] {{ background: {c.panel}; border: 1px solid {c.line}; border-radius: 4px; }}
    QFrame[kind="current"] {{ background: {c.window}; border: none; border-left: 3px solid {c.accent}; }}
    QLabel[kind="section"] {{ font-size: {SECTION}px; font-weight: 600; }}
    QLabel[kind="muted"] {{ color: {c.muted}; }}
    QLabel[kind="error"] {{ color: {c.bad}; }}
    QLabel[kind="caution"] {{ color: {c.caution}; }}
    QLabel[kind="partial"] {{ color: {c.partial}; font-weight: 600; }}
    QLineEdit[wrong="true"], QComboBox[wrong="true"] {{ border: 2px solid {c.bad}; border-radius: 4px; }}
    QListWidget#stage_list {{ background: transparent; }}
    QListWidget#stage_list::item {{ border-bottom: 1px solid {c.line}; }}
    QListWidget[kind="nav"] {{ background: transparent; border: none; outline: none; }}
    QListWidget[kind="nav"]::item {{
        height: {BUTTON}px; padding-left: {GRID}px; border-left: 3px solid transparent; color: {c.muted};
    }}
    QListWidget[kind="nav"]::item:selected {{
        background: {c.panel}; color: {c.text}; border-left-color: {c.accent};
    }}
    QScrollArea[kind="clear"], QScrollArea[kind="clear"] > #qt_scrollarea_viewport > QWidget {{
        background: transparent;
    }}
    QLabel[kind="number"] {{
        background: {c.accent}; color: {c.on_accent}; border-radius: 14px; min-height: 28px; min-width: 28px;
        font-weight: 600; qproperty-alignment: AlignCenter;
    }}
    QLabel[kind="pill"] {{
        border: 1px solid {c.line}; border-radius: 4px; padding: 0 {GRID}px; min-height: 28px; color: {c.text};
    }}
    QTableView {{ border: 1px solid {c.line}; }}
    QHeaderView {{ background: {c.panel}; }}
    QHeaderView::section {{ background: {c.panel}; color: {c.text}; border: none; padding: 0 {GRID // 2}px; }}
    QHeaderView::section:horizontal {{ border-bottom: 1px solid {c.line}; min-height: {3 * GRID}px; }}
    QTableCornerButton::section {{ background: {c.panel}; border: none; border-bottom: 1px solid {c.line}; }}
    QCheckBox::indicator {{ width: {5 * GRID // 2}px; height: {5 * GRID // 2}px; }}
    QCheckBox::indicator:unchecked {{
        border: 1px solid {c.muted}; border-radius: 3px; background: {c.field};
        width: {5 * GRID // 2 - 2}px; height: {5 * GRID // 2 - 2}px;
    }}
    QCheckBox::indicator:unchecked:hover, QCheckBox::indicator:unchecked:focus {{ border-color: {c.accent}; }}
    QCheckBox::indicator:unchecked:disabled {{ border-color: {c.line}; background: {c.window}; }}
    QProgressBar {{ border: none; border-radius: 4px; background: {c.track}; }}
    QProgressBar::chunk {{ border-radius: 4px; background: {c.accent}; }}
    QTabWidget#page_tabs > QTabBar::tab {{
        height: {TOP_BAR - 3}px; padding: 0 {3 * GRID // 2}px; border: none; border-bottom: 3px solid transparent;
        color: {c.muted}; font-size: {BODY}px;
    }}
    QTabWidget#page_tabs > QTabBar::tab:selected {{ color: {c.text}; border-bottom-color: {c.accent}; }}
    QTabWidget#page_tabs > QTabBar::tab:focus {{ color: {c.accent}; }}
    QTabBar[kind="views"]::tab {{
        height: {BUTTON - 3}px; padding: 0 {GRID}px; border: none; border-bottom: 3px solid transparent;
        color: {c.muted}; background: transparent;
    }}
    QTabBar[kind="views"]::tab:selected {{ color: {c.text}; border-bottom-color: {c.accent}; }}
    QTabBar[kind="views"]::tab:focus {{ color: {c.accent}; }}
    QTabWidget#page_tabs::pane {{ border: none; }}
    QToolTip {{ color: {c.text}; background: {c.panel}; border: 1px solid {c.line}; padding: {GRID // 2}px; }}
    """


def font(size: int = BODY, *, bold: bool = False) -> QFont:
    """Return the font of the window at a size in px; its figures have equal widths."""
    return QFont(_font(size, bold))


@cache
def _font(size: int, bold: bool) -> QFont:
    _load_font()
    made = QFont(FAMILY)
    made.setPixelSize(size)
    if bold:
        made.setWeight(QFont.Weight.DemiBold)
    return made


@cache
def _load_font() -> None:
    for file in library.fonts_folder().glob("*.otf"):
        QFontDatabase.addApplicationFont(str(file))


def painter(widget: QWidget) -> QPainter:
    """Return a painter that draws smooth lines on a widget."""
    made = QPainter(widget)
    made.setRenderHint(QPainter.RenderHint.Antialiasing)
    return made


def set_kind(widget: QWidget, kind: str) -> None:
    """Set the kind of a widget, such as primary, panel or muted, which selects its style in the style sheet."""
    widget.setProperty("kind", kind)
    widget.style().unpolish(widget)
    widget.style().polish(widget)
