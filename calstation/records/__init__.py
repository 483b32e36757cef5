"""What remains of a run: raw log, CSV, configuration, limits and checks, and the index of runs.

Solving, reports and the result JSON belong to other packages.
"""
