"""The engineer page: choice of stages, preview, and analysis of a result.

The computations are in `results`.
"""

from calstation.gui.engineer.page import EngineerPage
