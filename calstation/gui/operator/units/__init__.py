"""Several units on one table: the slots before a run, tiles of the units during it, and their verdicts."""

from calstation.gui.operator.units.banner import Banner
from calstation.gui.operator.units.slots_panel import SlotsPanel
from calstation.gui.operator.units.tile import COLUMNS
from calstation.gui.operator.units.unit_tiles import UnitTiles
from calstation.gui.operator.units.verdict_grid import VerdictGrid
