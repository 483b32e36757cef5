"""The language of the window: English or Simplified Chinese, switched while it is open."""

from pathlib import Path

from PySide6.QtCore import QCoreApplication, QLibraryInfo, QLocale, QTranslator
from PySide6.QtWidgets import QComboBox

from calstation.gui.text.binding import languages
from calstation.messages import Language

#: Code and own name of each language; English first.
LANGUAGES: tuple[tuple[Language, str], ...] = (("en", "English"), ("zh_CN", "中文"))

_FOLDER = Path(__file__).parents[1] / "translations"
_installed: list[QTranslator] = []
_current: Language = "en"


def current() -> Language:
    """Code of the current language."""
    return _current


def system_language() -> Language:
    """The language of the computer if the window has it, else English."""
    return "zh_CN" if QLocale.system().language() == QLocale.Language.Chinese else "en"


def use(code: str) -> None:
    """Switch to a language and show all bound texts again; an unknown code is English."""
    global _current
    app = QCoreApplication.instance()
    assert app is not None
    chosen: Language = "zh_CN" if code == "zh_CN" else "en"
    if chosen == _current:
        return
    _current = chosen
    for translator in _installed:
        app.removeTranslator(translator)
    _installed.clear()
    QLocale.setDefault(QLocale(QLocale.Language.C))
    theirs = Path(QLibraryInfo.path(QLibraryInfo.LibraryPath.TranslationsPath)) / f"qtbase_{chosen}.qm"
    for file in (theirs, *sorted(_FOLDER.glob(f"*_{chosen}.qm"))) if chosen != "en" else ():
        translator = QTranslator(app)
        if file.exists() and translator.load(str(file)):
            app.installTranslator(translator)
            _installed.append(translator)
    languages.changed.emit()


def language_combo() -> QComboBox:
    """A box with the languages under their own names; the data of its entries are the codes."""
    combo = QComboBox()
    combo.setObjectName("language_combo")
    for code, name in LANGUAGES:
        combo.addItem(name, code)
    return combo
