"""IMU drivers, which decode bytes to samples, and the transfer of calibration registers.

Stations are opened by `connection`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
