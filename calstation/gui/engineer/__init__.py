"""The engineer page: selection of stages, preview, and analysis of results; `calstation.results` computes them."""

from calstation.gui.engineer.page import EngineerPage
