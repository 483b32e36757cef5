"""Code that uses the true values of the virtual bench or injects faults: studies, soak tests, fault plans, recordings.

Production packages do not import it; its hooks are passed to a run by the caller.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
