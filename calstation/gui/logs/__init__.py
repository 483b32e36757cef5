"""The Offline page, which plots a log and solves it again; `results` contains the computations."""

from calstation.gui.logs.page import OfflinePage
