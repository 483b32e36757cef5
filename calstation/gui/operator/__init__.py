"""The Operator page: load, scan, START, live view, verdict; the state of the run is in `gui.shell`."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
