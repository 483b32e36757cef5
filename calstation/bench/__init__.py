"""The virtual bench: a simulated table and unit with known true values and the real protocols.

It shares only constants, units and parameter names with the other packages; estimators must not use its equations.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
