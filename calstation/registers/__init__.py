"""Registers of units: transfer, journal, interrupted transfers and verification.

The register maps of the drivers are in `devices`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
