"""The virtual bench: a table and a unit with a truth of their own and the real protocols.

It shares only constants, units and parameter names with the rest; no estimator may use its mathematics.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
