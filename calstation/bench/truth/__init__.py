"""The true state of the bench: motion, errors, noise and samples of units and tables.

It is independent of the estimators and contains no links or protocols.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
