"""The virtual bench: a simulated table and unit with known true values and the real protocols.

It shares only parameter names, steps of a plan and array types with the estimators, and none of their equations.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
