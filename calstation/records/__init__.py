"""Records of runs: raw logs, CSV, acceptance checks and the index of runs.

This package contains no solvers and no devices.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
