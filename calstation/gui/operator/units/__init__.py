"""Views of several units on one table: slots before a run, tiles during the run, and verdicts after it."""

from calstation.gui.operator.units.banner import Banner
from calstation.gui.operator.units.slots_panel import SlotsPanel
from calstation.gui.operator.units.tiles import COLUMNS, UnitTiles
from calstation.gui.operator.units.verdict_grid import VerdictGrid
