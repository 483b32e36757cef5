"""The panels of the Offline page for methods that need no rate table; `procedures` contains the methods."""

from calstation.gui.logs.methods.gimbal_view import GimbalView
from calstation.gui.logs.methods.guidance import CROSS_CALIBRATION, MULTI_POSITION, MethodBar
from calstation.gui.logs.methods.panel import MethodPanel
from calstation.gui.logs.methods.plots import SENSOR_UNITS, MethodPlot
