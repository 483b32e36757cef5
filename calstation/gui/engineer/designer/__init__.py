"""The schedule designer on the engineer page: goal of the search, result with plots, and saving.

The search is in `calstation.design`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
