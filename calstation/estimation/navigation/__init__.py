"""The 39-state navigation filter, its relinearisation and its observability analysis."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
