"""Opens and identifies devices, tests links, locks ports, and runs the process of the virtual bench.

Protocols are implemented in `devices`, motion in `sequencer`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
