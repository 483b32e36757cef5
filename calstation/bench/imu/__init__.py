"""The unit's processor: registers, flash, protocols and stream faults.

The measurements of its sensors are simulated in `bench.truth`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
