"""A run in progress: the table or the manual rig, traces, convergence, and the tiles of several units."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
