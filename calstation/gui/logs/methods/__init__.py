"""Methods that need no rate table, as panels of the Offline page; they themselves are in `procedures`."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
