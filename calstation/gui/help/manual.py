"""The manual: its chapters in order, and its sections, which can be searched.

A chapter may have a Chinese translation beside it, such as ``tutorial.zh.md``, with the same headings in the same
order. Paths and anchors are those of the English chapters in both languages.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from calstation.config import library
from calstation.gui.text import language, say

#: Catalogue code of the title of each group of chapters by the folder of the group.
GROUPS = {"how-to": "help.how_to", "reference": "help.reference", "explanation": "help.explanation"}
#: Chapters before and after the groups, as paths in the manual.
_FIRST, _LAST = ("index.md", "tutorial.md"), ("limits-of-judgement.md", "glossary.md", "contract.md")
#: Folder of the notes for the change log, which are not part of the manual.
_NOTES = "changes"
#: End of the names of Chinese chapters.
CHINESE = ".zh.md"


@dataclass(frozen=True)
class Section:
    """A section of the manual: the path and the title of its chapter, its own heading and anchor, and its text."""

    path: str
    chapter: str
    heading: str
    anchor: str
    text: str

    @property
    def target(self) -> str:
        """The path of the chapter with the anchor of the section."""
        return f"{self.path}#{self.anchor}"


def anchor(heading: str) -> str:
    """Return the anchor of a heading, as in the links of the manual."""
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def chapters() -> dict[str, list[tuple[str, str]]]:
    """Return the title and the path of each chapter by the catalogue code of its group, in the order of the manual."""
    listed, paths = {"help.start": list(_FIRST)}, _paths()
    for folder, code in GROUPS.items():
        listed[code] = [path for path in paths if path.startswith(f"{folder}/")]
    listed["help.further"] = list(_LAST)
    return {code: sorted_titles(paths, keep=code in ("help.start", "help.further")) for code, paths in listed.items()}


def sorted_titles(paths: list[str], *, keep: bool) -> list[tuple[str, str]]:
    """Return (title, path) of chapters in the order of `paths` if `keep`, else those in the current language first.

    Without `keep`, the chapters are also sorted by title. The title of a chapter without a translation says so.
    """
    titled = [(sections(path)[0].chapter, path) for path in paths]
    titled = titled if keep else sorted(titled, key=lambda each: (not _translated(each[1]), each))
    return [(title if _translated(path) else say("help.english_title", title=title), path) for title, path in titled]


def search(words: str) -> list[Section]:
    """Return the sections that contain all words; those with the words in their heading come first."""
    wanted = words.lower().split()
    matches = [
        section
        for path in _paths()
        for section in sections(path)
        if all(word in section.text.lower() or word in section.heading.lower() for word in wanted)
    ]
    return sorted(matches, key=lambda section: not all(word in section.heading.lower() for word in wanted))


def chapter_text(path: str) -> str:
    """Return the text of a chapter in the current language or, after a note that it is not translated, in English."""
    text = _read(path, _translated(path))
    return f"{say('help.not_translated')}\n\n{text}" if language.current() != "en" and not _translated(path) else text


def sections(path: str) -> tuple[Section, ...]:
    """Return the sections of a chapter; the first has the title of the chapter as its heading."""
    return _sections(path, _translated(path))


def _translated(path: str) -> bool:
    """Return whether a chapter is shown in Chinese."""
    return language.current() != "en" and _chinese(path) in _files(library.manual_folder())


def _chinese(path: str) -> str:
    return path.removesuffix(".md") + CHINESE


def _paths() -> list[str]:
    """Return the paths of all English chapters."""
    return [path for path in _files(library.manual_folder()) if not path.endswith(CHINESE)]


@cache
def _files(folder: Path) -> tuple[str, ...]:
    """Return the paths of the chapters in both languages."""
    pages = sorted(folder.rglob("*.md"))
    return tuple(page.relative_to(folder).as_posix() for page in pages if page.parent.name != _NOTES)


def _read(path: str, translated: bool) -> str:
    return (library.manual_folder() / (_chinese(path) if translated else path)).read_text(encoding="utf-8")


@cache
def _sections(path: str, translated: bool) -> tuple[Section, ...]:
    english = tuple(_split(path, _read(path, translated=False)))
    if not translated:
        return english
    chinese = _split(path, _read(path, translated=True))
    return tuple(replace(each, anchor=other.anchor) for each, other in zip(chinese, english, strict=False))


def _split(path: str, text: str) -> Iterator[Section]:
    chapter = heading = ""
    body: list[str] = []
    quoted = False
    for line in (*text.splitlines(), "# "):
        quoted ^= line.startswith("```")
        match = None if quoted else re.match(r"#+ (.*)", line)
        if match is None:
            body.append(line)
            continue
        if heading:
            yield Section(path, chapter, heading, anchor(heading), "\n".join(body))
        heading, body = match[1].strip(), []
        chapter = chapter or heading
