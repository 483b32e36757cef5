"""Calibration methods and solvers as pure functions of arrays.

They use no device, file, thread or window; the schedules are defined in `procedures`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
