"""The History page: stored runs, their details and trends; `results` searches and reads them."""

from calstation.gui.history.page import HistoryPage
