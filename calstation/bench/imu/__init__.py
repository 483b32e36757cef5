"""The unit's processor: registers, flash, protocols and the faults of its stream.

What its sensors measure belongs to `bench.truth`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
