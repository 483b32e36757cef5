"""Documents made from finished results: labels and certificates.

Code that evaluates or computes values belongs to `calstation.results`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
