from .live_view import LiveView as LiveView
from .position_picture import PositionPicture as PositionPicture
from .table_panel import TablePicture as TablePicture
