"""Background jobs of the window, with progress, in a process that can be killed; runs use a separate engine."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
