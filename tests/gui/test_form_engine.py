"""Fields that edit the values of a form: typed numbers, units, problems beside the entry, and changed values."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QLabel, QPushButton
from pytestqt.qtbot import QtBot

import calstation.gui
from calstation.config import library
from calstation.gui.logs.methods.panel import BenchBox
from calstation.gui.quality.study_view import PlanForm
from calstation.gui.state import AppContext
from calstation.gui.text import language
from calstation.gui.widgets import (
    ChoiceBox,
    CountEdit,
    EditableBox,
    FlagBox,
    FormField,
    FormValues,
    NumberEdit,
    SpinEdit,
    box,
    theme,
)
from calstation.messages import Language, Text
from calstation.physics import DISPLAY
from calstation.schema import Problem


def too_large(values: Mapping[str, Any]) -> Iterator[Problem]:
    """Find values above 10."""
    for name, value in values.items():
        if isinstance(value, float | int) and value > 10:
            yield Problem((name,), "less_than_equal", Text.of("entry.less_than_equal", bound=10, le=10))


def make_field(qtbot: QtBot, values: FormValues, name: str, editor: Any) -> FormField:
    field = FormField(values, (name,), editor, lambda: name, f"{name}_edit")
    field.grid.addWidget(editor, 0, 0)
    field.grid.addWidget(field.message, 1, 0)
    qtbot.addWidget(field)
    return field


def test_problem_is_shown_at_its_entry_only(qtbot: QtBot) -> None:
    values = FormValues({"a": 1.0, "b": 2.0}, too_large)
    first, second = (make_field(qtbot, values, name, NumberEdit()) for name in ("a", "b"))
    qtbot.keyClicks(first.editor, "5")
    assert values.values == {"a": 15, "b": 2.0}
    assert first.message.text() == "Out of range; it must be at most 10."
    assert (first.editor.property("invalid"), second.editor.property("invalid")) == (True, False)
    assert (first.message.isHidden(), second.message.isHidden()) == (False, True)
    assert values.differs(("a",))
    assert not values.differs(("b",))
    values.reset()
    assert values.values == {"a": 1.0, "b": 2.0}
    assert (first.editor.value(), first.message.text()) == (1, "")


def test_edit_does_not_change_values_that_were_returned_before() -> None:
    values = FormValues({"targets": {}})
    values.set({("targets", "a"): 0.0})
    returned = values.values
    values.set({("targets", "a"): 0.5})
    assert (returned, values.values) == ({"targets": {"a": 0.0}}, {"targets": {"a": 0.5}})


def test_text_is_not_replaced_while_it_is_typed(qtbot: QtBot) -> None:
    values = FormValues({"a": None})
    field = make_field(qtbot, values, "a", NumberEdit())
    qtbot.keyClicks(field.editor, "1.50")
    assert (field.editor.property("text"), values.values) == ("1.50", {"a": 1.5})


def test_unchanged_text_in_a_display_unit_keeps_the_exact_value(qtbot: QtBot) -> None:
    exact = 9.696273622190721e-08
    edit = NumberEdit(DISPLAY["gyro_bias"][1])
    field = make_field(qtbot, FormValues({"a": exact}), "a", edit)
    text = edit.text()
    assert text.startswith("0.02")
    edit.selectAll()
    qtbot.keyClicks(edit, "0.5")
    assert field.editor.value() != exact
    edit.selectAll()
    qtbot.keyClicks(edit, text)
    assert field.editor.value() == exact


def test_value_of_a_table_is_removed_by_an_empty_text(qtbot: QtBot) -> None:
    values = FormValues({"targets": {"gyro_bias": 1.0}})
    values.set({("targets", "gyro_bias"): None})
    assert values.values == {"targets": {}}
    assert values.stored == {"targets": {"gyro_bias": 1.0}}


def test_flags_and_limited_numbers_edit_their_values(qtbot: QtBot) -> None:
    values = FormValues({"flag": False, "number": 1.0})
    flag, spin = FlagBox(), SpinEdit(0.0, 5.0, 1.0, 0)
    make_field(qtbot, values, "flag", flag)
    field = make_field(qtbot, values, "number", spin)
    flag.click()
    spin.setValue(9.0)
    assert values.values == {"flag": True, "number": 5.0}
    field.lock("No.")
    assert (spin.isEnabled(), spin.toolTip()) == (False, "No.")


@pytest.mark.parametrize(
    ("code", "seed", "trials"),
    [
        (
            "en",
            "Enter an integer from 1 to 9999 for “unit” instead of “90000”.",
            "Enter an integer from 2 to 20 for “Trials” instead of “30”.",
        ),
        (
            "zh_CN",
            "“产品号”请输入 1 至 9999 的整数，而不是“90000”。",
            "“次数”请输入 2 至 20 的整数，而不是“30”。",
        ),
    ],
)
def test_number_outside_its_limits_stays_and_starts_nothing(
    qtbot: QtBot, code: Language, seed: str, trials: str
) -> None:
    language.use(code)
    bench, plans = BenchBox("multi_position"), []
    plan = PlanForm(lambda: library.find("products", "mems_c"), plans.append)
    made: list[tuple[str, int]] = []
    bench.requested.connect(lambda *values: made.append(values))
    for form, name, typed, press, sentence in (
        (bench, "bench_seed_multi_position", "90000", "bench_make_multi_position", seed),
        (plan, "study_trials_edit", "30", "study_save_button", trials),
    ):
        qtbot.addWidget(form)
        form.show()
        edit = form.findChild(CountEdit, name)
        edit.selectAll()
        qtbot.keyClicks(edit, typed)
        qtbot.mouseClick(form.findChild(QPushButton, press), Qt.MouseButton.LeftButton)
        assert edit.text() == typed
        assert edit.property("invalid"), "its border is red"
        assert sentence in [each.text() for each in form.findChildren(QLabel) if each.isVisible()]
    assert (made, plans) == ([], [])
    bench.seed_edit.selectAll()
    qtbot.keyClicks(bench.seed_edit, "42")
    assert not bench.seed_edit.property("invalid")
    assert seed not in [each.text() for each in bench.findChildren(QLabel) if each.isVisible()]
    qtbot.mouseClick(bench.make_button, Qt.MouseButton.LeftButton)
    assert made == [("mems", 42)]
    language.use("en")


def test_window_has_no_spin_box_that_swallows_digits() -> None:
    """A spin box of Qt ignores a digit beyond its limit, which makes another number; `LimitedSpin` reports it."""
    pattern = re.compile(r"\bQ(?:Double)?SpinBox\(")
    folder = Path(calstation.gui.__file__).parent
    assert [path.name for path in folder.rglob("*.py") if pattern.search(path.read_text("utf-8"))] == []


@pytest.mark.parametrize("name", ["light", "dark"])
def test_red_border_of_a_wrong_input_leaves_its_text_visible(app: AppContext, qtbot: QtBot, name: str) -> None:
    theme.apply(name)
    spin = SpinEdit(0.0, 10.0, 1.0, 2)
    spin.setValue(2.5)
    editable, choice, edit = EditableBox(("9600", "19200")), ChoiceBox(lambda: [(1, "12.5")]), NumberEdit()
    editable.show_value(12.5)
    edit.show_value(12.5)
    form = box(spin, editable, choice, edit)
    qtbot.addWidget(form)
    form.show()
    inner = [(line, line.width()) for line in (spin.lineEdit(), editable.line)]
    for each in (spin, editable, choice, edit):
        theme.set_invalid(each, invalid=True)
        qtbot.wait(20)
        image, red = each.grab().toImage(), QColor(theme.colours().bad)
        assert image.pixelColor(image.width() // 2, 1) == red, type(each)
        assert image.pixelColor(image.width() - 1, image.height() // 2) == red, type(each)
    for line, width in inner:
        assert line.width() == width
    theme.apply("light")
