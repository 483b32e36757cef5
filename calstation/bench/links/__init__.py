"""Servers and serial lines through which the station communicates with the bench.

They contain no physics and no protocol states.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
