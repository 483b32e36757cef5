"""Repeated solution of many stored logs on many cores, and comparison of the solutions of two versions.

The package writes to the shared database. It contains no solvers: `calstation.results` solves the logs.
"""

from calstation.fleet.comparison import GROUPS, Comparison, ParameterShift, VerdictChange
from calstation.fleet.jobs import compare, compare_job, export_job, export_version, versions_job
from calstation.fleet.resolving import UNCHANGED, FleetRequest, FleetSummary, resolve_fleet, solved_results
from calstation.fleet.sources import Selection
