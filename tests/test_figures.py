"""The figures of `make figures` count what they say."""

from tests.figures import figures

PRODUCT = """
def solve(log, first, last):
    \"\"\"Solve.

    Parameters
    ----------
    log : a log
    \"\"\"
    found = log
    assert found


def show(a, b, c):
    \"\"\"Show a belief.\"\"\"
"""


def test_figures_count_lines_asserts_functions_and_words() -> None:
    files = {
        "calstation/__init__.py": "",
        "calstation/a.py": PRODUCT,
        "tests/test_a.py": "1\n2\n",
        "calstation/a.pyi": "1\n",
    }
    values = list(figures(files).values())
    assert values == ["14", "2", "1", "1", "1", "1", "0", "2, 1", f"{1000 * 2 / 14:.1f}"]
