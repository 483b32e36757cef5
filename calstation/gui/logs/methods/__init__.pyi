from .gimbal_view import GimbalView as GimbalView
from .kinds import MethodBar as MethodBar
from .panel import MethodPanel as MethodPanel
from .plots import MethodPlot as MethodPlot
