"""The engineer page: choice of stages, preview, and analysis of a result.

The computations are in `results`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
