"""Serial, Modbus and text links with time limits for every exchange.

A link knows no meaning of what it carries.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
