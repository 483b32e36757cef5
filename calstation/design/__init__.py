"""Schedules of the method `designed`: search for the shortest one, and analysis of the effects that it detects.

Sigmas come from the run's own plan and filter; no code in this package drives a table.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
