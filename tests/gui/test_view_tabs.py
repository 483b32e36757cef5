"""The bar of tabs above the views of a page."""

from pytestqt.qtbot import QtBot

from calstation.gui.widgets import ViewTabs, box, row


def test_bar_widens_for_a_tab_that_appears(qtbot: QtBot) -> None:
    tabs = ViewTabs("tabs", "engineer.preview", "common.parameters", "common.live")
    tabs.setTabVisible(2, False)
    page = box(row(tabs, None))
    qtbot.addWidget(page)
    page.resize(900, 60)
    page.show()
    before = tabs.width()
    tabs.setTabVisible(2, True)
    qtbot.waitUntil(lambda: tabs.width() > before)
    assert tabs.tabRect(2).right() <= tabs.width()
    assert tabs.tabRect(0).left() >= 0
