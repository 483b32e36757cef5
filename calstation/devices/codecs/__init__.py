"""Numbers, checks and conventions as bytes and registers hold them.

Pure functions; no profile and no port.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
