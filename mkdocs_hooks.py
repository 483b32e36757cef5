"""Pages of the documentation site that show the notebooks, which are kept without output."""

import json
from pathlib import Path
from typing import Any

_SUFFIX, _PAGE = ".ipynb", ".md"


def notebook_page(path: Path) -> str:
    """Return the cells of a notebook as Markdown, with a link to the notebook."""
    parts = [f"[Download the notebook]({path.name})"]
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
    title = next(k for k, part in enumerate(parts) if part.startswith("# "))
    heading, _, rest = parts.pop(title).partition("\n")
    return "\n\n".join([heading, *parts[:1], rest.strip(), *parts[1:]]) + "\n"


def on_files(files: Any, config: Any) -> Any:
    """Add a page for each notebook."""
    from mkdocs.structure.files import File

    for file in [each for each in files if each.src_uri.endswith(_SUFFIX)]:
        page = file.src_uri.removesuffix(_SUFFIX) + _PAGE
        files.append(File.generated(config, page, content=notebook_page(Path(file.abs_src_path))))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Let links to notebooks lead to their pages, except on these pages."""
    is_notebook = page.file.src_uri.startswith("notebooks/")
    return markdown if is_notebook else markdown.replace(f"{_SUFFIX})", f"{_PAGE})")
