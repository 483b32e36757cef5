from .kinds import MethodBar as MethodBar
from .panel import MethodPanel as MethodPanel
