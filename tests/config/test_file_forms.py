"""Forms for files: values in display units become the file's values, and tables keep their comments when moved."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.config import FORMS, FormCell, arrange_entries, edit_toml, library
from calstation.config.editing import MODELS
from calstation.physics import DISPLAY, from_unit, in_unit
from calstation.schema import KeyPath, problems_of

FILES = [(form, path) for form in FORMS for path in sorted((library.shipped_folder() / form.kind).glob("*.toml"))]


def value_at(data: Any, key_path: KeyPath) -> Any:
    for key in key_path:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return None
    return data


@pytest.mark.parametrize(("form", "path"), FILES, ids=lambda value: getattr(value, "stem", getattr(value, "name", "")))
def test_every_shipped_value_is_shown_and_unedited_values_change_nothing(form: Any, path: Path) -> None:
    data = tomllib.loads(path.read_text(encoding="utf-8"))

    def get(key_path: KeyPath) -> Any:
        return value_at(data, key_path)

    rows, columns = form.rows(get), form.columns(get)
    entries = [name for root in form.roots for name in (get(root) or ())]
    assert bool(rows) == bool(entries) or form.names == "key"
    for row in rows:
        assert len(row.cells) == len(columns)
        for cell in row.cells:
            if isinstance(cell, FormCell):
                shown = cell.displayed(get)
                assert cell.changes(get, shown) == {}
                value = cell.value(get)
                if isinstance(value, float) and cell.kind == "number":
                    assert float(shown) * cell.unit[1] == pytest.approx(value, rel=1e-5)


@given(st.sampled_from(sorted(DISPLAY)), st.integers(1, 999999), st.integers(-6, 3))
def test_number_in_a_display_unit_is_shown_as_typed(group: str, digits: int, exponent: int) -> None:
    typed = float(f"{digits}e{exponent}")
    size = DISPLAY[group][1]
    assert float(in_unit(from_unit(typed, size), size)) == typed


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (4.84813681109536e-08, "gyro_bias", "0.01"),
        (4.848137e-08, "gyro_bias", "0.01"),
        (0.0052, "gyro_bias", "1072.58"),
        (0.003, "gyro_scale", "3000"),
        (50.0, "accel_bias", "5098580"),
        (-0.1, "inner_lever", "-100"),
    ],
)
def test_value_is_shown_with_the_digits_in_the_file(value: float, unit: str, text: str) -> None:
    assert in_unit(value, DISPLAY[unit][1]) == text


LEAVES = st.one_of(
    st.none(), st.booleans(), st.integers(-9, 9), st.floats(), st.sampled_from(["", "x", "gyro_bias", "f32", "row"])
)
KEYS = st.sampled_from(
    ["gyro_bias", "within", "range", "sigma", "sigma_below_after", "parameters", "output", "gyro_lsb"]
)
ANYTHING = st.recursive(
    LEAVES, lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(KEYS, inner, max_size=3))
)
ROOTS = st.dictionaries(st.sampled_from([str(root[0]) for form in FORMS for root in form.roots]), ANYTHING)


@given(ROOTS, st.sampled_from(FORMS), st.sampled_from(["", "1", "-2.5", "x", "9" * 400]))
def test_invalid_content_of_a_file_is_shown_and_can_be_replaced(data: Any, form: Any, typed: str) -> None:
    def get(key_path: KeyPath) -> Any:
        return value_at(data, key_path)

    for row in form.rows(get):
        assert len(row.cells) == len(form.columns(get))
        for cell in row.cells:
            if isinstance(cell, FormCell):
                cell.displayed(get)
                cell.changes(get, typed)


def interval(within: Any, end: int, typed: str) -> Mapping[KeyPath, Any]:
    data = {"limits": {"x": {} if within is None else {"within": within}}}
    cell = FormCell(("limits", "x", "within"), end=end, magnitude=True)
    return cell.changes(lambda key_path: value_at(data, key_path), typed)


WITHIN: KeyPath = ("limits", "x", "within")


@pytest.mark.parametrize(
    ("within", "end", "typed", "changes"),
    [
        (2.0, 1, "3", {WITHIN: 3}),
        (2.0, 0, "-1", {WITHIN: [-1, 2.0]}),
        (2.0, 0, "-2", {}),
        (2.0, 0, "", {}),
        (2.0, 1, "", {WITHIN: None}),
        ([-1.0, 2.0], 0, "-3", {(*WITHIN, 0): -3}),
        ([-1.0, 2.0], 1, "", {WITHIN: [-1.0, ""]}),
        ([-1.0, ""], 0, "", {WITHIN: None}),
        ([-1.0, 2.0], 0, "", {WITHIN: 2.0}),
        ([-3.0, -2.0], 0, "", {WITHIN: ["", -2.0]}),
        ([1.0], 0, "", {WITHIN: None}),
        (None, 1, "3", {WITHIN: 3}),
        (None, 0, "-3", {WITHIN: [-3, ""]}),
        ([1.0], 1, "3", {WITHIN: [1.0, 3]}),
        ([{}], 1, "3", {WITHIN: [{}, 3]}),
    ],
)
def test_interval_ends_are_edited_separately(within: Any, end: int, typed: str, changes: Mapping[KeyPath, Any]) -> None:
    assert interval(within, end, typed) == changes


def test_invalid_value_of_a_union_type_gives_one_problem() -> None:
    product = tomllib.loads((library.shipped_folder() / "products" / "nav_a.toml").read_text(encoding="utf-8"))
    for within, key_path in (("x", ()), ([1.0, "x"], (1,)), (["x", "y"], (0,)), ([2.0, 1.0], ())):
        product["limits"]["gyro_bias"]["within"] = within
        problems = problems_of(MODELS["products"], product)
        assert problems[0].key_path == ("limits", "gyro_bias", "within", *key_path)
        assert len(problems) == (2 if within == ["x", "y"] else 1)


# Tables and the comments on them

TABLES = """\
name = "x" # of the unit

# All limits.
[limits.a] # first
within = 1.0

[limits.b]
within = [ -1.0, 2.0 ] # both ends

# All checks.
[checks.c]
below = [
    [1],
]
"""


@pytest.mark.parametrize(
    ("changes", "old", "new"),
    [
        ({("limits", "b"): None}, "[limits.b]\nwithin = [ -1.0, 2.0 ] # both ends\n\n", ""),
        ({("limits", "a", "within"): None}, "[limits.a] # first\nwithin = 1.0\n\n", ""),
        ({("limits", "d"): {}}, "# All checks", "[limits.d]\n\n# All checks"),
        ({("limits", "d", "within"): 2.0}, "# All checks", "[limits.d]\nwithin = 2.0\n\n# All checks"),
        ({("limits", "b", "sigma"): 2.0}, "both ends\n", "both ends\nsigma = 2.0\n"),
        ({("limits", "b", "after", "rate"): 2.0}, "both ends\n", "both ends\nafter = {rate = 2.0}\n"),
        ({("limits", "b", "within", 0): -3.0}, "[ -1.0, 2.0 ]", "[ -3.0, 2.0 ]"),
        ({("checks", "c"): None}, "\n# All checks.\n[checks.c]\nbelow = [\n    [1],\n]\n", ""),
    ],
)
def test_change_keeps_every_comment_at_its_table(changes: Mapping[KeyPath, Any], old: str, new: str) -> None:
    assert edit_toml(TABLES, changes) == TABLES.replace(old, new, 1)


ENTRIES = """\
# The whole unit.
name = "x"

# One.
[[r]]
n = 1
[r.more]
deep = true

# Two.
[[r]]
n = 2

[end]
x = 1
"""


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        (
            [1, 0],
            '# The whole unit.\nname = "x"\n\n# Two.\n[[r]]\nn = 2\n\n# One.\n[[r]]\nn = 1\n[r.more]\ndeep = true\n\n'
            "[end]\nx = 1\n",
        ),
        ([1], '# The whole unit.\nname = "x"\n\n# Two.\n[[r]]\nn = 2\n\n[end]\nx = 1\n'),
        ([0, 1], ENTRIES),
        ([0, 1, {"n": 3}], ENTRIES.replace("\n[end]", "\n[[r]]\nn = 3\n\n[end]")),
    ],
)
def test_entries_of_a_list_move_with_their_comments(order: list[Any], expected: str) -> None:
    assert arrange_entries(ENTRIES, "r", order) == expected


def test_single_comment_before_a_list_stays_first() -> None:
    text = "# All.\n[[r]]\nn = 1\n\n[[r]]\nn = 2\n"
    assert arrange_entries(text, "r", [1, 0]) == "# All.\n[[r]]\nn = 2\n\n[[r]]\nn = 1\n"
    assert arrange_entries(text, "r", [1]) == "# All.\n[[r]]\nn = 2\n"


@pytest.mark.parametrize("text", ["a = 1\nr = [{ n = 1 }, { n = 2 }] # list\n", "a = 1\nr = []", "a = 1"])
def test_inline_list_becomes_an_array_of_tables(text: str) -> None:
    present = tomllib.loads(text).get("r", [])
    changed = arrange_entries(text, "r", [*reversed(range(len(present))), {"n": 3}])
    assert tomllib.loads(changed) == {"a": 1, "r": [*reversed(present), {"n": 3}]}
