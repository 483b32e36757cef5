"""Re-solving of many logs on many cores, and comparison of the solutions of two versions.

The package writes into the shared database and contains no solvers; the logs are solved by `calstation.results`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
