"""Executes steps, guards motion and emits events for one table and its units.

The package is independent of file formats and user interfaces.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
