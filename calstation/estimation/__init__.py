"""Methods and solvers as pure functions of arrays.

No device, file, thread or window; schedules belong to `procedures`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
