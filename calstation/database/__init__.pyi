from .connect import connect as connect
from .connect import upgrade as upgrade
from .tables import log_copies as log_copies
from .tables import revisions as revisions
from .tables import runs as runs
from .tables import solutions as solutions
