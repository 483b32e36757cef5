"""Table drivers: Modbus registers, text commands, an indexing unit, and a manual rig.

The drivers execute commands; motion limits are checked before a command is given.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
