"""Chapters of the manual in Chinese have the structure, the commands and the links of the English chapters."""

import re
from pathlib import Path

import pytest

from calstation.config import library

CHINESE = ".zh.md"
CHAPTERS = sorted(library.manual_folder().rglob(f"*{CHINESE}"))


def outside_blocks(text: str) -> list[str]:
    """Return the lines outside blocks of code."""
    return re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE).splitlines()


def structure(text: str) -> list[str]:
    """Return the levels of the headings, the rows of tables, and the items of lists, in their order."""
    lines = outside_blocks(text)
    kinds = (re.match(r"#+ |\s*(?:\||\d+\. |- )", line) for line in lines)
    return [kind[0] for kind in kinds if kind is not None]


def code(text: str) -> list[str]:
    """Return the lines of code without comments, the commands, and the names between backticks, sorted."""
    blocks = re.findall(r"^```.*?^```", text, flags=re.DOTALL | re.MULTILINE)
    lines = [re.sub(r"\s*#.*", "", line) for block in blocks for line in block.splitlines()]
    plain = "\n".join(outside_blocks(text))
    commands = re.findall(r"^ {4}(?:calstation|make|pip|python|\.venv|\{).*", plain, re.MULTILINE)
    names = (" ".join(name.split()) for name in re.findall(r"`[^`]+`", plain))
    return sorted([*lines, *commands, *names])


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda file: file.name)
def test_chinese_chapter_corresponds_to_the_english_one(chapter: Path) -> None:
    english = chapter.with_name(chapter.name.removesuffix(CHINESE) + ".md").read_text(encoding="utf-8")
    chinese = chapter.read_text(encoding="utf-8")
    assert structure(chinese) == structure(english)
    assert code(chinese) == code(english)
    translated, links = (re.findall(r"\]\(([^)\s]+)\)", text) for text in (chinese, english))
    assert sorted(link.replace(".zh.png", ".png") for link in translated) == sorted(links)
    for picture in (link for link in links if link.endswith(".png")):
        own = picture.replace(".png", ".zh.png")
        assert (own in translated) == (chapter.parent / own).exists(), "the picture of the window in Chinese"


def test_operators_and_engineers_have_their_chapters_in_chinese() -> None:
    names = {file.name.removesuffix(CHINESE) for file in CHAPTERS}
    assert names >= {
        "operate",
        "tutorial",
        "connect",
        "verdict",
        "several-units",
        "production-line",
        "history",
        "design-a-schedule",
        "temperature",
        "faults",
    }
