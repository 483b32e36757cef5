"""Widgets shared by several pages, and the theme; this package does not depend on runs, stations or devices."""

from calstation.gui.widgets import theme
from calstation.gui.widgets.badge import (
    StateBadge,
    StateIcon,
    draw_state,
    padlock_icon,
    painted_pixmap,
    state_colour,
    state_icon,
    theme_icon,
)
from calstation.gui.widgets.drawing import VIEWER, Drawing, apart, basis, circle, depth, screen
from calstation.gui.widgets.file_dialog import ask_file, ask_folder, ask_open, proposed_file, set_subject
from calstation.gui.widgets.form import FormField, FormValues, NameBar, choices_of, make_input, problem_text
from calstation.gui.widgets.inputs import (
    ChoiceBox,
    CountEdit,
    EditableBox,
    Editor,
    FlagBox,
    LimitedSpin,
    NumberEdit,
    ScanEdit,
    SpinEdit,
    TextEdit,
    VectorEdit,
    typed_number,
)
from calstation.gui.widgets.jobs import JobRow, JobStack, JobWatch, Slot
from calstation.gui.widgets.layout import (
    PANEL,
    STEPS,
    DataView,
    ElidedLabel,
    EmptyState,
    Item,
    PageArea,
    PlainLabel,
    ViewTabs,
    box,
    button,
    clear,
    column,
    combo_box,
    enable,
    fill_combo,
    grid,
    label,
    lay_out,
    line_edit,
    panel,
    plain_tip,
    progress_bar,
    row,
    scroll_area,
    show_text,
    split,
    stack,
)
from calstation.gui.widgets.notice import Choice, NoticeBar
from calstation.gui.widgets.parameter_table import (
    NOTABLE_SIGMAS,
    ROW,
    Cell,
    CellTable,
    Column,
    ParameterModel,
    ParameterTable,
    align_columns,
    ordered,
)
from calstation.gui.widgets.plot import (
    LineLabel,
    LineLabels,
    LogAxis,
    NumberAxis,
    PlotMenu,
    PlotNote,
    ThemedPlot,
    TimeBox,
    ZoomBox,
    fit_below_note,
    spread,
)
from calstation.gui.widgets.result_views import ChecksTable, ComparisonTable, MissingEffect, ParameterSet
from calstation.gui.widgets.stacked_plots import Band, StackedPlots, dashed, time_unit
from calstation.gui.widgets.temperature_curves import TemperatureCurves
from calstation.gui.widgets.text_area import ShrinkingText
