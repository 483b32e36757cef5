"""The language of the window, English or Simplified Chinese, which can be switched while the window is open."""

from pathlib import Path

from PySide6.QtCore import QCoreApplication, QLibraryInfo, QLocale, QTranslator
from PySide6.QtWidgets import QComboBox

from calstation.gui.text.binding import languages
from calstation.messages import Language

#: Code and native name of each language, English first.
LANGUAGES: tuple[tuple[Language, str], ...] = (("en", "English"), ("zh_CN", "中文"))

_FOLDER = Path(__file__).parents[1] / "translations"
_installed: list[QTranslator] = []
_current: Language = "en"


def current() -> Language:
    """Return the code of the current language."""
    return _current


def system_language() -> Language:
    """Return the code of the operating system's language if the window supports it, otherwise the code of English."""
    return "zh_CN" if QLocale.system().language() == QLocale.Language.Chinese else "en"


def use(code: str) -> None:
    """Switch to a language and show all bound texts again; an unknown code selects English."""
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
    qt_file = Path(QLibraryInfo.path(QLibraryInfo.LibraryPath.TranslationsPath)) / f"qtbase_{chosen}.qm"
    for file in (qt_file, *sorted(_FOLDER.glob(f"*_{chosen}.qm"))) if chosen != "en" else ():
        translator = QTranslator(app)
        if file.exists() and translator.load(str(file)):
            app.installTranslator(translator)
            _installed.append(translator)
    languages.changed.emit()


def language_combo() -> QComboBox:
    """Create a combo box that lists the languages by native name; the data of each item is the code."""
    combo = QComboBox()
    combo.setObjectName("language_combo")
    for code, name in LANGUAGES:
        combo.addItem(name, code)
    return combo
