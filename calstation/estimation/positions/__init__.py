"""Joint solution of rests and motions without table angles, and the checks and guidance of such recordings."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
