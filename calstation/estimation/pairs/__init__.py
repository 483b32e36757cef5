"""Cross-calibration of IMUs on one body: checks, fit and live monitoring."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
