"""The Help page: the manual, opened at the section about the current page, and facts about the program."""

from calstation.gui.help.page import HelpPage
