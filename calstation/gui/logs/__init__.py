"""The Offline page: one log, drawn and solved again by its stages or by a method; the work is done in `results`."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
