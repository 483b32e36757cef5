"""Drivers of IMUs, from bytes to samples, and the transfer of calibration registers.

Opening a station belongs to `connection`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
