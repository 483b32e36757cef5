"""Encoding of numbers, checksums and matrix conventions in bytes and registers.

All functions are pure and depend on neither profiles nor ports.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
