"""The History page, which shows stored runs, their details and trends; `results` searches and reads the runs."""

from calstation.gui.history.page import HistoryPage
