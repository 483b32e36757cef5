"""The solver chain, solving logs again, the result model, history and hand-over; no devices, no estimators."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
