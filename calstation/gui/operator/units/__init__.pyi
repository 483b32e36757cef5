from .banner import Banner as Banner
from .slots import Slot as Slot
from .slots import Slots as Slots
from .slots_panel import SlotsPanel as SlotsPanel
from .tile import COLUMNS as COLUMNS
from .unit_tiles import UnitTiles as UnitTiles
from .verdict_grid import VerdictGrid as VerdictGrid
