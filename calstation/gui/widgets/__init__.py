"""Widgets that several pages share, and the theme; nothing here knows a run, a station or a device."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
