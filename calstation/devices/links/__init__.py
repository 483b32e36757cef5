"""Serial, Modbus and text links with a time limit for every exchange.

A link does not interpret the data that it transfers.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
