"""Opening and identifying devices, link tests, port locks, and the process of the virtual bench.

Protocols belong to `devices`, motion to `sequencer`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
