"""Additions to the operator page for a production line: badges, the shift counter, pictures and labels."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
