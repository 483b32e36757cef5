"""The Offline page, which plots a log and solves it again; the computations are in `results`."""

from calstation.gui.logs.page import OfflinePage
