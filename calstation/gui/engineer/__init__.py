"""The engineer page: selection of stages, preview, and analysis of the results that `calstation.results` computes."""

from calstation.gui.engineer.page import EngineerPage
