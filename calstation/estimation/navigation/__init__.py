"""The 39-state navigation filter, its relinearisation and its observability analysis."""

from calstation.estimation.navigation.information import (
    Drifts,
    Segment,
    advance_information,
    join_segments,
    precision,
    segment_information,
)
from calstation.estimation.navigation.navigation_pass import ClosedLoopFilter, NavigationPass, ReferencePass
from calstation.estimation.navigation.relinearise import solve_navigation
from calstation.estimation.navigation.response import result_sensitivity
from calstation.estimation.navigation.stage import NavigationStage, warm_up
from calstation.estimation.navigation.temperature_stage import TemperatureStage, temperature_parts
from calstation.estimation.navigation.velocity_group import BIAS
