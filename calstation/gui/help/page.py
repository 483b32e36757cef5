"""The Help page: list of chapters, search, and the text of a chapter."""

from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, QUrl
from PySide6.QtGui import QDesktopServices, QImage, QTextBlock, QTextCharFormat, QTextCursor, QTextDocument
from PySide6.QtWidgets import QListWidget, QListWidgetItem, QTextBrowser, QTextEdit

from calstation.config import library
from calstation.gui.help import manual
from calstation.gui.help.about import ABOUT, LICENCE, about_text, licence_text
from calstation.gui.state import AppContext, Page
from calstation.gui.text import bind, say
from calstation.gui.widgets import button, column, line_edit, row, theme

#: Width of the list of chapters, px, and maximum number of listed sections that contain the searched words.
_LIST_WIDTH, _MAX_MATCHES = 44 * theme.GRID, 100
_MARKDOWN = QTextDocument.ResourceType.MarkdownResource
_TARGET = Qt.ItemDataRole.UserRole


class ManualBrowser(QTextBrowser):
    """Shows a chapter of the manual, the facts about the program, or a licence, and follows their links."""

    def __init__(self, app: AppContext) -> None:
        super().__init__()
        self._app = app
        self._words: list[str] = []
        self.setObjectName("manual_browser")
        self.setOpenLinks(False)
        self.document().setDocumentMargin(3 * theme.GRID)
        self.anchorClicked.connect(self.open)

    def open(self, url: QUrl) -> None:
        """Open a chapter or a text of the program here, and any other URL with the default program of the system."""
        if url.scheme() == "help" or url.path().endswith(".md"):
            self.setSource(url)
        else:
            QDesktopServices.openUrl(url)

    def mark(self, words: list[str]) -> None:
        """Highlight words in this chapter and in those opened later."""
        self._words = words
        selections = []
        for word in words:
            cursor = QTextCursor(self.document())
            while not (cursor := self.document().find(word, cursor)).isNull():
                selection: Any = QTextEdit.ExtraSelection()
                selection.cursor, selection.format = cursor, QTextCharFormat()
                selection.format.setBackground(theme.faint(theme.colours().caution, 90))
                selections.append(selection)
        self.setExtraSelections(selections)

    def loadResource(self, kind: int, name: QUrl | str) -> Any:
        """Return the text of a URL of the program, or an image that is not wider than the page."""
        url = self.source().resolved(QUrl(name))
        if url.scheme() == "help":
            path = url.toString()
            return licence_text(path.removeprefix(LICENCE)) if path != ABOUT else about_text(self._app.runs_folder)
        if path := chapter_path(url):
            return manual.chapter_text(path)
        if kind == QTextDocument.ResourceType.ImageResource.value:
            image = QImage(url.toLocalFile())
            width = self.viewport().width() - 8 * theme.GRID
            smooth = Qt.TransformationMode.SmoothTransformation
            return image.scaledToWidth(width, smooth) if image.width() > width > 0 else image
        return super().loadResource(kind, name)

    def doSetSource(self, name: QUrl | str, type: QTextDocument.ResourceType = _MARKDOWN) -> None:
        """Show a text, and scroll to the heading that the URL names."""
        url = QUrl(name)
        super().doSetSource(url, _MARKDOWN)
        self._space()
        self.mark(self._words)
        if url.hasFragment():
            block = self._heading(url.fragment())
            top = self.document().documentLayout().blockBoundingRect(block).top()
            self.verticalScrollBar().setValue(round(top))

    def _space(self) -> None:
        """Set the distances between paragraphs, which Qt does not derive from a font with a size in px."""
        block = self.document().begin()
        while block.isValid():
            cursor, form = QTextCursor(block), block.blockFormat()
            if cursor.currentTable() is None and not form.nonBreakableLines() and not form.indent():
                form.setTopMargin(2.0 * theme.GRID if form.headingLevel() else 0.5 * theme.GRID)
                form.setBottomMargin(theme.GRID)
                cursor.setBlockFormat(form)
            block = block.next()

    def _heading(self, anchor: str) -> QTextBlock:
        """Return the heading of the section with an anchor, or the first line of the text."""
        path = chapter_path(self.source())
        heading = next((each.heading for each in manual.sections(path) if each.anchor == anchor), "") if path else ""
        block = self.document().begin()
        while block.isValid():
            if block.blockFormat().headingLevel() and manual.anchor(block.text()) == manual.anchor(heading):
                return block
            block = block.next()
        return self.document().begin()


def chapter_path(url: QUrl) -> str:
    """Return the path of a chapter in the manual, or "" for another text or file."""
    file, folder = Path(url.toLocalFile()), library.manual_folder()
    inside = url.isLocalFile() and file.suffix == ".md" and file.is_relative_to(folder)
    return file.relative_to(folder).as_posix() if inside else ""


class HelpPage(Page):
    """The page with the manual, which works without a network, and with the facts about the program."""

    def __init__(self, app: AppContext) -> None:
        super().__init__(app, "help")
        self.browser = ManualBrowser(app)
        self.list = QListWidget()
        self.list.setObjectName("manual_list")
        self.list.setWordWrap(True)
        self.list.setSpacing(theme.GRID // 4)
        self.list.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        # Qt does not adapt the heights of rows that a scroll bar narrows later, so wrapped rows would overlap
        self.list.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOn)
        self.search_edit = line_edit("manual_search_edit", self._search, hint="help.search")
        self.search_edit.setClearButtonEnabled(True)
        bind(self.search_edit.setAccessibleName, "help.search")
        self._back = button("manual_back_button", "help.back", self.browser.backward)
        self._about = button("about_button", "help.about", self.show_about)
        self.search_edit.setFixedWidth(_LIST_WIDTH)
        self.list.setFixedWidth(_LIST_WIDTH)
        wide = 2 * theme.GRID
        left = column(self.search_edit, (self.list, 1), self._about)
        right = column(row(self._back, None), (self.browser, 1))
        row(left, (right, 1), on=self, spacing=wide, margins=(wide, theme.GRID, wide, wide))
        self.setFocusProxy(self.search_edit)
        self.list.itemClicked.connect(self._open_item)
        self.list.itemActivated.connect(self._open_item)
        self.browser.backwardAvailable.connect(self._back.setEnabled)
        self._back.setEnabled(False)
        theme.on_appearance_change(self, self._refresh)
        self.open("index.md")

    @property
    def target(self) -> str:
        """The displayed chapter as a path in the manual, or the URL of another text."""
        url = self.browser.source()
        return chapter_path(url) or url.toString()

    def open(self, target: str) -> None:
        """Show a chapter of the manual, given by its path and, after ``#``, the anchor of a section."""
        path, _, anchor = target.partition("#")
        url = QUrl.fromLocalFile(str(library.manual_folder() / path))
        if anchor:
            url.setFragment(anchor)
        self.browser.setSource(url)

    def show_about(self) -> None:
        """Show the facts about the program."""
        self.browser.setSource(QUrl(ABOUT))

    def _search(self) -> None:
        """List the sections that contain the searched words or, without words, the chapters."""
        words = self.search_edit.text().strip()
        self.list.clear()
        if not words:
            for group, chapters in manual.chapters().items():
                self._add_heading(say(group))
                for title, path in chapters:
                    self._add(title, path)
        else:
            matches = manual.search(words)
            self._add_heading(say("help.found", count=len(matches)))
            for each in matches[:_MAX_MATCHES]:
                name = each.heading if each.heading == each.chapter else f"{each.heading}  ·  {each.chapter}"
                self._add(name, each.target)
        self.browser.mark(words.split())

    def _add_heading(self, text: str) -> None:
        item = QListWidgetItem(text, self.list)
        item.setFlags(Qt.ItemFlag.NoItemFlags)
        item.setFont(theme.font(bold=True))

    def _add(self, text: str, target: str) -> None:
        item = QListWidgetItem(text, self.list)
        item.setData(_TARGET, target)

    def _open_item(self, item: QListWidgetItem) -> None:
        if target := item.data(_TARGET):
            self.open(target)

    def _refresh(self) -> None:
        """Show the texts in the current language and the colours of the current theme."""
        self._search()
        self.browser.reload()
