"""The main window and the objects that all pages share: application context, engine link, run status and role."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
