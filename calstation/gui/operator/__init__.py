"""The operator page: loading, scan, START, live view and verdict; the run status is in `gui.shell`."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
