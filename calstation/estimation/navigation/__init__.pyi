from .filter import NavigationFilter as NavigationFilter
from .relinearise import solve_navigation as solve_navigation
from .stage import NavigationStage as NavigationStage
from .stage import warm_up as warm_up
from .velocity_group import BIAS as BIAS
