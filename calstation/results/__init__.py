"""The solver chain, re-solving of logs, the result model, history and hand-over; no devices, no estimators."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
