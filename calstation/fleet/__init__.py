"""Re-solving of many logs on many cores, and comparison of the solutions of two versions.

The package writes into the shared database and contains no solvers; the logs are solved by `calstation.results`.
"""

from calstation.fleet.comparison import GROUPS, Comparison, ParameterShift, VerdictChange
from calstation.fleet.jobs import compare, compare_job, export_job, export_version, versions_job
from calstation.fleet.resolving import UNCHANGED, FleetRequest, FleetSummary, resolve_fleet, solved_results
from calstation.fleet.sources import Selection
