"""The Offline page: plots one log and solves it again by its stages or a method; `results` computes."""

from calstation.gui.logs.page import OfflinePage
