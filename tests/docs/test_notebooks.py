"""The notebooks of the documentation run from top to bottom."""

import json
import sys
from pathlib import Path
from runpy import run_path

import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
SLOWEST = "design_and_simulate"


def code_of(notebook: Path) -> list[str]:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def test_there_are_four_notebooks_without_output() -> None:
    assert len(NOTEBOOKS) == 4
    for notebook in NOTEBOOKS:
        cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
        assert not any(cell.get("outputs") for cell in cells)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_has_a_page_on_the_site(notebook: Path) -> None:
    hooks = run_path(str(FOLDER.parents[1] / "mkdocs_hooks.py"))
    page = hooks["notebook_page"](notebook)
    assert page.startswith("# ")
    assert f"]({notebook.name})" in page
    for code in code_of(notebook):
        assert f"```python\n{code}\n```" in page
    assert f"notebooks/{notebook.stem}.md" in (FOLDER.parents[1] / "mkdocs.yml").read_text(encoding="utf-8")


@pytest.mark.long
@pytest.mark.parametrize(
    "notebook",
    [pytest.param(each, marks=[pytest.mark.exhaustive] * (each.stem == SLOWEST), id=each.stem) for each in NOTEBOOKS],
)
def test_notebook_runs(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    names: dict[str, object] = {"__name__": "__main__"}
    for number, code in enumerate(code_of(notebook)):
        exec(compile(code, f"{notebook.name}, cell {number}", "exec"), names)
    if "matplotlib" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
