"""Views of a run in progress: table or manual rig, traces and convergence."""

from calstation.gui.operator.live.live_view import LiveView
from calstation.gui.operator.live.position_picture import PositionPicture
from calstation.gui.operator.live.table_panel import TablePicture
from calstation.gui.operator.live.temperature_panel import TemperaturePanel
