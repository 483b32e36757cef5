"""Panels of the Offline page for the methods that need no rate table; `procedures` contains the methods."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
