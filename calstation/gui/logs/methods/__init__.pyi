from .method_bar import MethodBar as MethodBar
from .panel import MethodPanel as MethodPanel
