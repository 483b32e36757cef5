"""The table's controller: drives, limits, watchdog, register maps and text protocols.

The true motion of the joints is simulated in `bench.truth`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
