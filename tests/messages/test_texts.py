"""Every text of the window and the command line is an entry of the catalogue, and every entry is used."""

import ast
import re
from collections.abc import Iterator

import pytest

from calstation.messages import catalogue, known
from tests.messages.test_codes import INTERFACES, ROOT, TAKES_CODE, all_entries, call_name, calls, trees

pytestmark = pytest.mark.long

#: Packages of pages, each with a family of texts of the same name.
_PACKAGES = {file.parent.name for file in (ROOT / "calstation" / "gui").glob("*/page.py")} - {"state"}
#: Families of the texts of pages and commands; no name of their entries comes from data alone.
PAGES = {"cli", "common", "window"} | _PACKAGES

#: Functions of Qt and of the terminal that show texts as they are, and the index of the first one.
SHOWS_TEXT = {
    **dict.fromkeys(("setText", "setToolTip", "setTitle", "setPlaceholderText", "setAccessibleName"), 0),
    **dict.fromkeys(("setAccessibleDescription", "setSpecialValueText", "setPlainText", "addAction", "addItem"), 0),
    **dict.fromkeys(("setHorizontalHeaderLabels", "setNameFilters"), 0),
    **dict.fromkeys(("setTabText", "setTabToolTip", "setItemText", "setLabel", "show_state", "show_text", "enable"), 1),
    **dict.fromkeys(("print", "print_error", "add_column", "add_row", "add_task", "job_progress", "prompt"), 0),
    **dict.fromkeys(("TextColumn", "Table"), 0),
    "show_line": 1,
}

#: Parts that are the same in every language: placeholders, HTML, formats of files, units, names of commands.
SAME = re.compile(r"\{[^}]*\}|<[^>]*>|(CSV|JSON|Parquet|PNG|SVG) \(\*\.\w+\)|°/h|m/s²|calstation( \w+)?")

WORD = re.compile(r"[^\W\d_]{2,}")
SENTENCE = re.compile(r"[A-Za-z]{2,},? [A-Za-z]{2,}")

#: Sentences that nobody reads in the window or the terminal: fonts, the application log, comments of files.
NOT_SHOWN = {
    *("DejaVu Sans Mono", "WenQuanYi Micro Hei Mono", "a run is in progress", "Allan deviation of ,  s", "_fast"),
    *("bind needs a widget or a bound method of a Qt object", "the command ended with a programming error"),
    "from PySide6.QtWidgets import QApplication\nsize = QApplication([]).primaryScreen().availableSize()\n"
    "print(size.width(), size.height())",
}

#: The style of the window.
STYLE = "calstation/gui/widgets/theme.py"


def interfaces() -> Iterator[tuple[str, ast.Module]]:
    """Yield the modules of the window and the command line with their paths."""
    return ((path, tree) for path, tree in trees() if path.startswith(INTERFACES))


def literals(tree: ast.AST) -> Iterator[ast.Constant | ast.JoinedStr]:
    """Yield all strings and f-strings except docstrings and placeholders of options."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node
        elif isinstance(node, ast.JoinedStr):
            yield node
            for value in node.values:
                yield from () if isinstance(value, ast.Constant) else literals(value)
        elif not (
            (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
            or (isinstance(node, ast.keyword) and node.arg == "metavar")
        ):
            yield from literals(node)


def shown(node: ast.expr) -> str:
    """Return what a literal shows, without the values of an f-string; "" for any other expression."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(map(shown, node.values))
    if isinstance(node, ast.List | ast.Tuple):
        return " ".join(map(shown, node.elts))
    return f"{shown(node.body)} {shown(node.orelse)}" if isinstance(node, ast.IfExp) else ""


def pattern(node: ast.JoinedStr) -> str:
    """Return a regular expression for the texts of an f-string."""
    return "".join(re.escape(p.value) if isinstance(p, ast.Constant) else r"\w*" for p in node.values)


def families_named_by_data() -> set[str]:
    """Return the families whose names come from data, as in ``term("stage", name)`` and ``f"stage.{name}"``."""
    found = {spec for e in all_entries() for spec in re.findall(r":@(\w+)}", e.text + e.remedy)}
    for _, tree in trees():
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr) and re.fullmatch(r"[a-z_]+\\\.\\w\*", pattern(node)):
                found.add(pattern(node).partition("\\")[0])
        for call, _ in calls(tree):
            partial = call_name(call) == "partial" and getattr(call.args[0], "id", "") == "term"
            if partial or call_name(call) in ("term", "_labelled"):
                found.add(shown(call.args[1 if partial else 0]))
    return found


def test_every_code_in_the_window_and_the_command_line_is_in_the_catalogue() -> None:
    families, unknown = set(catalogue.families()), []
    for path, tree in interfaces():
        codes = [
            node
            for node in literals(tree)
            if isinstance(node, ast.Constant)
            and shown(node).partition(".")[0] in families
            and re.fullmatch(r"[a-z_]+\.[a-z]\w*", shown(node))
            and not shown(node).endswith((".csv", ".ini", ".json"))
        ]
        for call, _ in calls(tree):
            index = TAKES_CODE.get(call_name(call), len(call.args))
            codes += [arg for arg in call.args[index : index + 1] if isinstance(arg, ast.Constant) and arg.value]
        unknown += [f"{path}:{node.lineno} {shown(node)}" for node in codes if not known(shown(node))]
    assert not unknown, "\n".join(unknown)


def test_no_text_of_the_window_or_the_command_line_is_a_literal() -> None:
    literal = []
    for path, tree in interfaces():
        for call, _ in calls(tree):
            texts = [*call.args[SHOWS_TEXT.get(call_name(call), len(call.args)) :]]
            texts += [word.value for word in call.keywords if word.arg in ("title", "tip", "text")]
            for text in texts:
                code = known(shown(text)) and call_name(call) not in SHOWS_TEXT
                if not code and shown(text) not in NOT_SHOWN and WORD.search(SAME.sub("", shown(text))):
                    literal.append(f"{path}:{text.lineno} {shown(text)}")
        for node in literals(tree) if path != STYLE else ():
            if shown(node) not in NOT_SHOWN and SENTENCE.search(SAME.sub("", shown(node))):
                literal.append(f"{path}:{node.lineno} {shown(node)}")
    assert not literal, "\n".join(literal)


def test_every_entry_is_used() -> None:
    by_data = families_named_by_data()
    assert not by_data & PAGES
    nodes = [node for _, tree in trees() for node in ast.walk(tree)]
    used = {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    forms = {pattern(node) for node in nodes if isinstance(node, ast.JoinedStr)}
    forms = {form for form in forms if re.match(r"[a-z_]+\\\.", form)}
    unused = [
        e.code
        for e in all_entries()
        if e.code not in used
        and e.code.partition(".")[0] not in by_data
        and not any(re.fullmatch(form, e.code) for form in forms)
    ]
    assert not unused
