"""Quality over time: control charts, capability, yield and measurement system analysis of stored runs."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
