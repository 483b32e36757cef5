"""The language of the window, English or Simplified Chinese, which can be changed while the window is open."""

from PySide6.QtCore import QCoreApplication, QLibraryInfo, QLocale, QObject, QTranslator, Signal
from PySide6.QtWidgets import QComboBox

from calstation.messages import Language

#: Code and native name of each language, English first.
LANGUAGES: tuple[tuple[Language, str], ...] = (("en", "English"), ("zh_CN", "中文"))

_current: Language = "en"

#: Translator for the texts of Qt itself, for example in file dialogs.
_qt_texts = QTranslator()


class _Languages(QObject):
    changed = Signal()


#: Emits `changed` after `use` has changed the language.
languages = _Languages()


def current() -> Language:
    """Return the code of the current language."""
    return _current


def system_language() -> Language:
    """Return the code of the language of the operating system or, if it is not supported, of English."""
    return "zh_CN" if QLocale.system().language() == QLocale.Language.Chinese else "en"


def use(code: str) -> None:
    """Switch to a language, and update all bound texts; an unknown code selects English."""
    global _current
    selected: Language = "zh_CN" if code == "zh_CN" else "en"
    if selected == _current:
        return
    _current = selected
    QLocale.setDefault(QLocale(QLocale.Language.C))
    QCoreApplication.removeTranslator(_qt_texts)
    folder = QLibraryInfo.path(QLibraryInfo.LibraryPath.TranslationsPath)
    if selected != "en" and _qt_texts.load(f"qtbase_{selected}", folder):
        QCoreApplication.installTranslator(_qt_texts)
    languages.changed.emit()


def language_combo() -> QComboBox:
    """Create a combo box of the languages, with their native names as texts and their codes as data."""
    combo = QComboBox()
    combo.setObjectName("language_combo")
    for code, name in LANGUAGES:
        combo.addItem(name, code)
    return combo
