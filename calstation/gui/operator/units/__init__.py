"""Several units on one table: the slots before a run, tiles of the units during it, and their verdicts."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
