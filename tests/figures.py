"""Print figures of the source code, for the checkout and for every commit named: make figures [SINCE=COMMIT]."""

import ast
import io
import re
import subprocess
import sys
import tarfile
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PRODUCT, TESTS = ("calstation/", "procedures/"), ("tests/",)

#: Parts of names, and words anywhere, that are stilted or private.
NAMES = {
    *("found", "place", "places", "held", "wanted", "own", "asked", "left", "made", "belief", "misfit", "look"),
    *("most", "beyond", "enough", "clearer"),
}
WORDS = re.compile(
    r"(?<![a-z])(belief|misfit|mend|errand|mailbox|spoilt|spool|wander|foresee|unfit|workshop|vouching|not_settled|"
    r"golden|overview|proof|proven|lacking|said to be|in force|of a unit that|None where)(?![a-z])",
    re.IGNORECASE,
)


def sources(commit: str | None) -> dict[str, str]:
    """Return the text files of the checkout, or of a commit, by their path."""
    if commit is None:
        names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        files = {name: ROOT / name for name in names.split("\0") if name and (ROOT / name).is_file()}
        return {name: file.read_text("utf-8", "replace") for name, file in files.items() if counted(name)}
    packed = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        members = [member for member in archive if member.isfile() and counted(member.name)]
        return {m.name: archive.extractfile(m).read().decode("utf-8", "replace") for m in members}


def counted(name: str) -> bool:
    """Return whether a file has figures."""
    return name.startswith((*PRODUCT, *TESTS)) and name.endswith((".py", ".pyi", ".ts"))


def public_functions(tree: ast.Module) -> list[ast.FunctionDef]:
    """Return the public functions and methods of a module with three or more arguments."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")]
    return [function for function in functions if len([*function.args.args, *function.args.kwonlyargs]) >= 3]


def given(tree: ast.Module) -> Iterator[str]:
    """Yield the names that a module gives to variables, arguments, functions and classes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name


def figures(files: dict[str, str]) -> dict[str, str]:
    """Return the figures by their name."""
    product = {name: text for name, text in files.items() if name.startswith(PRODUCT) and name.endswith(".py")}
    trees = {name: ast.parse(text) for name, text in product.items()}
    lines = {name: text.count("\n") for name, text in files.items()}
    functions = [function for tree in trees.values() for function in public_functions(tree)]
    words = sum(len(WORDS.findall(text)) for text in product.values())
    words += sum(bool(NAMES.intersection(name.lower().split("_"))) for tree in trees.values() for name in given(tree))

    def total(condition: Callable[[str], bool]) -> int:
        return sum(count for name, count in lines.items() if condition(name))

    size = total(product.__contains__)
    asserts = sum(isinstance(node, ast.Assert) for tree in trees.values() for node in ast.walk(tree))
    documented = sum("Parameters\n" in (ast.get_docstring(function) or "") for function in functions)
    return {
        "lines of Python, calstation and procedures": f"{size}",
        "lines of Python, tests": f"{total(lambda name: name.startswith(TESTS) and name.endswith('.py'))}",
        "assert statements at run time": f"{asserts}",
        "packages": f"{sum(name.endswith('/__init__.py') for name in product)}",
        "modules": f"{sum(not name.endswith('/__init__.py') for name in product)}",
        "lines of .pyi": f"{total(lambda name: name.endswith('.pyi'))}",
        "lines of .ts": f"{total(lambda name: name.endswith('.ts'))}",
        "public functions of 3 or more arguments, with Parameters": f"{len(functions)}, {documented}",
        "stilted or private words per 1,000 lines": f"{1000.0 * words / size:.1f}",
    }


def main(commits: list[str]) -> None:
    """Print a column for each commit and one for the checkout."""
    columns = {name or "checkout": figures(sources(name or None)) for name in (*commits, "")}
    rows = [["", *(name[:12] for name in columns)]]
    rows += [[label, *(column[label] for column in columns.values())] for label in columns["checkout"]]
    for label, *values in rows:
        sys.stdout.write(f"{label:<58}{''.join(f'{value:>14}' for value in values)}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
