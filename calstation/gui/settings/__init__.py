"""The Station page: station, links, site, table, profiles and their versions.

`config` checks and stores the files.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
