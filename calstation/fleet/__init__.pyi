from .resolving import FleetRequest as FleetRequest
from .resolving import FleetSummary as FleetSummary
from .resolving import resolve_fleet as resolve_fleet
from .resolving import solved_results as solved_results
