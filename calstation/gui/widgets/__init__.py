"""Widgets shared by several pages, and the theme; this package does not depend on runs, stations or devices."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
