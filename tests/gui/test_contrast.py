"""Contrast of the theme's colours, by the formula of WCAG 2: 4.5 for text, 3 for lines and symbols."""

import pytest
from PySide6.QtGui import QColor, QPalette

from calstation.gui.widgets import theme

SURFACES = ("window", "panel", "field")
STATES = ("accent", "good", "bad", "caution")
#: Text and its background: everywhere; on filled buttons and selected rows; on the verdict; on a pressed button.
TEXT = [
    *((text, surface) for text in ("text", "muted", *STATES) for surface in SURFACES),
    *(("on_accent", "accent"), ("text", "track"), ("on_alarm", "alarm")),
    *(("on_state", state) for state in ("muted", *STATES)),
]
#: Lines, borders and symbols, and what they are drawn on; the filled part of a bar and the rest of it.
LINES = [
    *(("alarm", surface) for surface in ("window", "panel")),
    *((line, surface) for line in ("line", "muted", *STATES) for surface in SURFACES),
    *(("accent", "track"), ("good", "track"), ("text", "track"), ("muted", "track")),
]


def luminance(colour: QColor) -> float:
    """Return the relative luminance."""
    parts = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour.getRgbF()[:3])
    return sum(weight * part for weight, part in zip((0.2126, 0.7152, 0.0722), parts, strict=True))


def contrast(first: QColor | str, second: QColor | str) -> float:
    """Return the contrast ratio of two colours."""
    low, high = sorted((luminance(QColor(first)), luminance(QColor(second))))
    return (high + 0.05) / (low + 0.05)


@pytest.fixture(params=["light", "dark"])
def colours(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> theme.Colours:
    """Colours of a theme, which is the current one."""
    monkeypatch.setattr(theme, "_current", request.param)
    return theme.colours()


def test_black_on_white_has_the_largest_contrast() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)


def test_text_has_sufficient_contrast(colours: theme.Colours) -> None:
    ratios = {pair: contrast(*(getattr(colours, role) for role in pair)) for pair in TEXT}
    assert not {pair: ratio for pair, ratio in ratios.items() if ratio < 4.5}


def test_lines_have_sufficient_contrast(colours: theme.Colours) -> None:
    ratios = {pair: contrast(*(getattr(colours, role) for role in pair)) for pair in LINES}
    assert not {pair: ratio for pair, ratio in ratios.items() if ratio < 3.0}


def test_plot_axes_have_sufficient_contrast(colours: theme.Colours) -> None:
    for axis, colour in theme.AXIS_COLOURS.items():  # curves and arrows are drawn on panels
        assert contrast(colour, colours.panel) >= 3.0, axis
        assert contrast(theme.axis_text(axis), colours.panel) >= 4.5, axis


def test_every_text_role_of_the_palette_has_sufficient_contrast(colours: theme.Colours) -> None:
    palette, roles = theme.palette(colours), QPalette.ColorRole
    pairs = [
        (roles.WindowText, roles.Window),
        (roles.Text, roles.Base),
        (roles.Text, roles.AlternateBase),
        (roles.ButtonText, roles.Button),
        (roles.PlaceholderText, roles.Base),
        (roles.HighlightedText, roles.Highlight),
        (roles.ToolTipText, roles.ToolTipBase),
        (roles.Link, roles.Base),
    ]
    for group in (QPalette.ColorGroup.Active, QPalette.ColorGroup.Inactive, QPalette.ColorGroup.Disabled):
        for text, background in pairs:
            assert contrast(palette.color(group, text), palette.color(group, background)) >= 4.5, (group, text)
