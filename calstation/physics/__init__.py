"""Error model, earth, strapdown, table geometry, motion steps and units.

This package uses no filter, file or device.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
