"""Stations, products, profile library, resolved run configuration, editing, versions and access rights."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
