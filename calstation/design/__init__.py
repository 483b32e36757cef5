"""Schedules of the method `designed`: the search for the shortest one, and what a schedule can and cannot show.

Sigmas come from the run's own plan and filter; nothing here drives a table.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
