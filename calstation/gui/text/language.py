"""English and Simplified Chinese, switched while the window runs."""

from pathlib import Path

from PySide6.QtCore import QCoreApplication, QLibraryInfo, QLocale, QTranslator
from PySide6.QtWidgets import QComboBox, QWidget

from calstation.gui.text.bind import languages

#: Code and own name of each language; English first.
LANGUAGES = (("en", "English"), ("zh_CN", "中文"))

_FOLDER = Path(__file__).parents[1] / "translations"
_installed: list[QTranslator] = []
_current = "en"


def current() -> str:
    """Code of the language in force."""
    return _current


def system_language() -> str:
    """The computer's language where the window speaks it, else English."""
    return "zh_CN" if QLocale.system().language() == QLocale.Language.Chinese else "en"


def use(code: str) -> None:
    """Speak a language from now on; every widget hears of it as a LanguageChange event."""
    global _current
    app = QCoreApplication.instance()
    assert app is not None
    code = code if code in dict(LANGUAGES) else "en"
    if code == _current:
        return
    _current = code
    for translator in _installed:
        app.removeTranslator(translator)
    _installed.clear()
    QLocale.setDefault(QLocale(QLocale.Language.C))
    if _current != "en":
        _install(code)
    languages.changed.emit()


def _install(code: str) -> None:
    app = QCoreApplication.instance()
    assert app is not None
    own = sorted(_FOLDER.glob(f"*_{code}.qm"))
    theirs = Path(QLibraryInfo.path(QLibraryInfo.LibraryPath.TranslationsPath)) / f"qtbase_{code}.qm"
    for file in (theirs, *own):
        translator = QTranslator(app)
        if file.exists() and translator.load(str(file)):
            app.installTranslator(translator)
            _installed.append(translator)


def language_combo(parent: QWidget | None = None) -> QComboBox:
    """A box with every language in its own words; its entries' data are the codes."""
    combo = QComboBox(parent)
    combo.setObjectName("language_combo")
    for code, name in LANGUAGES:
        combo.addItem(name, code)
    return combo
