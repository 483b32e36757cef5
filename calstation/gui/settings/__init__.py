"""The Station page: station, links, site, table, profiles and their versions.

Checking and storing files belongs to `config`.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
