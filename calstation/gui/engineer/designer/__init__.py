"""The schedule designer on the engineer page: what to search for, the answer in figures and plots, and saving it.

The search is in `calstation.design`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
