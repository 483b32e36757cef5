"""Joint solution of rests and motions without table angles, and checks and guidance for such recordings."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
