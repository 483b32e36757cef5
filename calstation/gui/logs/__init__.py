"""The Offline page: one log, drawn and solved again by its stages or by a method.

Reading and solving belong to `results` and run as jobs.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
