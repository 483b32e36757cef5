"""Facts about the program as Markdown: version, folders, validations, and licences of the program and its libraries."""

import platform
import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from PySide6.QtCore import QUrl, qVersion

from calstation import __version__, applog
from calstation.config import library
from calstation.errors import CalstationError
from calstation.gui.text import language, say, term
from calstation.messages import local_time
from calstation.validation import read_validation

#: URL of this text, and start of the URLs of the licences.
ABOUT, LICENCE = "help:about", "help:licence/"
#: Name of the program, and of its font, in the URL of the licence.
_PROGRAM, _FONT = "calstation", "font"
#: Maximum length of the name of a licence.
_MAX_NAME_LENGTH = 40
#: Maximum number of listed validations, the latest first.
_MAX_VALIDATIONS = 5


def about_text(runs_folder: Path) -> str:
    """Return the facts about the program in the current language."""
    logs = applog.folder() or library.site_folder() / "logs"
    folders = (
        ("help.logs_folder", logs),
        ("help.site_folder", library.site_folder()),
        ("help.runs_folder", runs_folder.absolute()),
    )
    lines = [
        f"# calstation {__version__}",
        say("help.about_program", licence=f"[MIT]({LICENCE}{_PROGRAM})", font=f"[OFL]({LICENCE}{_FONT})"),
        f"Python {platform.python_version()}, Qt {qVersion()}, {platform.platform(terse=True)}",
        f"## {say('help.folders')}",
        *(f"- {say(code)}: [{folder}]({_url(folder)})" for code, folder in folders),
        f"## {say('help.validations')}",
        *_validations(library.site_folder(), runs_folder.absolute().parent),
        f"## {say('help.libraries')}",
    ]
    rows = [f"| {say('help.library')} | {say('help.version')} | {say('help.licence')} |", "|---|---|---|"]
    for each in _libraries():
        rows.append(f"| {each.name} | {each.version} | [{_licence_name(each)}]({LICENCE}{each.name}) |")
    return "\n\n".join([*lines, "\n".join(rows)])


def licence_text(name: str) -> str:
    """Return the licence of the program, of its font or of a library as a block of Markdown."""
    if name == _FONT:
        files = [library.fonts_folder() / "OFL.txt"]
    elif name == _PROGRAM:
        files = [library.manual_folder().parent / "LICENSE"]
    else:
        listed = distribution(name).files or []
        files = [Path(str(each.locate())) for each in listed if re.search(r"licen[cs]e|copying", each.name, re.I)]
    texts = [file.read_text(encoding="utf-8", errors="replace") for file in files if file.suffix != ".py"]
    return f"# {name}\n\n" + "\n\n".join(f"```\n{text}\n```" for text in texts or [_licence_name(distribution(name))])


def _validations(*folders: Path) -> list[str]:
    """Return a line for each of the latest validations in the folders, or a line that says that there is none."""
    files = {file.name: file for folder in folders for file in (folder / "validation").glob("validation_*.json")}
    latest = [files[name] for name in sorted(files, reverse=True)[:_MAX_VALIDATIONS]]
    return [f"- {_validation(file)}" for file in latest] or [say("help.no_validation")]


def _validation(file: Path) -> str:
    """Return the time and the verdict of a validation with a link to its document, or why its record is not valid."""
    try:
        data = read_validation(file)
    except CalstationError as error:
        return say(error.as_text)
    documents = [file.with_name(f"{file.stem}{ending}.pdf") for ending in ("_zh", "")[language.current() == "en" :]]
    document = next((each for each in documents if each.is_file()), None)
    link = say("help.no_document", file=documents[-1].name) if document is None else f"[PDF]({_url(document)})"
    verdict = term("validation_label", f"verdict_{data['verdict']}")
    return f"{local_time(data['started_utc'])}  ·  {data['computer']}  ·  {verdict}  ·  {link}"


def _url(folder: Path) -> str:
    return QUrl.fromLocalFile(str(folder)).toString(QUrl.ComponentFormattingOption.FullyEncoded)


def _libraries() -> list[Distribution]:
    """Return the installed libraries that the program requires, except libraries for its development."""
    try:
        required = distribution(_PROGRAM).requires or []
    except PackageNotFoundError:  # run from a source tree that was never installed
        return []
    names = {re.split(r"[^\w.-]", each)[0].lower() for each in required if not re.search("extra == .dev.", each)}
    installed = []
    for name in sorted(names):
        try:
            installed.append(distribution(name))
        except PackageNotFoundError:
            continue
    return installed


def _licence_name(each: Distribution) -> str:
    """Return the short name of the licence of a library, or the title of its text; a dash if there is neither."""
    metadata = each.metadata
    names = [name for field in ("License-Expression", "License") for name in metadata.get_all(field) or []]
    names += [entry.rpartition(" :: ")[2] for entry in metadata.get_all("Classifier") or [] if "License ::" in entry]
    short = next((name for name in names if name and len(name) <= _MAX_NAME_LENGTH and "\n" not in name), None)
    title = next((line.strip() for name in names for line in name.splitlines() if line.strip()), "–")
    return short or (title if len(title) <= _MAX_NAME_LENGTH else "–")
