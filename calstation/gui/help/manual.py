"""The manual: its chapters in order, and its sections, which can be searched."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from calstation.config import library

#: Groups of chapters by their folder, with the catalogue code of the title of each group; "" for single chapters.
GROUPS = {"how-to": "help.how_to", "reference": "help.reference", "explanation": "help.explanation"}
#: Chapters before and after the groups, as paths in the manual.
_FIRST, _LAST = ("index.md", "tutorial.md"), ("limits-of-judgement.md", "glossary.md", "contract.md")
#: Folder of the notes for the change log, which are not part of the manual.
_NOTES = "changes"


@dataclass(frozen=True)
class Section:
    """A section of the manual: the path and the title of its chapter, its own heading, and its text."""

    path: str
    chapter: str
    heading: str
    text: str

    @property
    def target(self) -> str:
        """The path of the chapter with the anchor of the section."""
        return f"{self.path}#{anchor(self.heading)}"


def anchor(heading: str) -> str:
    """Return the anchor of a heading, as in the links of the manual."""
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def chapters() -> dict[str, list[tuple[str, str]]]:
    """Return the title and the path of each chapter by the catalogue code of its group, in the order of the manual."""
    listed = {"help.start": list(_FIRST)}
    for folder, code in GROUPS.items():
        found = sorted((library.manual_folder() / folder).glob("*.md"))
        listed[code] = [f"{folder}/{file.name}" for file in found]
    listed["help.further"] = list(_LAST)
    return {code: sorted_titles(paths, keep=code in ("help.start", "help.further")) for code, paths in listed.items()}


def sorted_titles(paths: list[str], *, keep: bool) -> list[tuple[str, str]]:
    """Return titles and paths of chapters, sorted by title unless their order is to be kept."""
    titled = [(sections(path)[0].chapter, path) for path in paths if (library.manual_folder() / path).is_file()]
    return titled if keep else sorted(titled)


def search(words: str) -> list[Section]:
    """Return the sections that contain all words; those with the words in their heading come first."""
    wanted = words.lower().split()
    pages = sorted(file for file in library.manual_folder().rglob("*.md") if file.parent.name != _NOTES)
    paths = [file.relative_to(library.manual_folder()).as_posix() for file in pages]
    found = [
        section
        for path in paths
        for section in sections(path)
        if all(word in section.text.lower() or word in section.heading.lower() for word in wanted)
    ]
    return sorted(found, key=lambda section: not all(word in section.heading.lower() for word in wanted))


@cache
def sections(path: str) -> tuple[Section, ...]:
    """Return the sections of a chapter; the first has the title of the chapter as its heading."""
    text = (library.manual_folder() / path).read_text(encoding="utf-8")
    return tuple(_split(path, text))


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
            yield Section(path, chapter, heading, "\n".join(body))
        heading, body = match[1].strip(), []
        chapter = chapter or heading
