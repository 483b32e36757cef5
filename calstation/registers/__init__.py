"""What is written into units: transfer, journal, interrupted transfers and verification.

A driver's register map belongs to `devices`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
