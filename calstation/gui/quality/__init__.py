"""The Quality page: control charts, capability, yield, check standards and repeatability over many runs.

Statistics are computed in `calstation.quality`; single runs are shown on the History page.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
