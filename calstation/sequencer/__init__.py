"""Executes steps, guards motion and emits events for one table and its units.

The package is independent of user interfaces; it writes the raw log only through `Slot.journal`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
