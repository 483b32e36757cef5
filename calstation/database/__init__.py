"""The database shared by several stations: its tables, the exchange of a station with it, and the archive of logs.

The files of a station remain authoritative and no run waits for the database. The package contains no solvers.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
