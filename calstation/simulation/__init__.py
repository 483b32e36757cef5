"""Everything that uses the truth of the virtual bench or injects faults: studies, soak, fault plans, recordings.

Production packages do not import it; a run gets its hooks from outside.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
