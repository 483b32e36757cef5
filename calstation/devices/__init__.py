"""Tables and IMUs: profiles, links, codecs and drivers.

No driver decides whether a motion is allowed; the sequencer does.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
