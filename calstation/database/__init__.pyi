from .archive import LogCopy as LogCopy
from .archive import archive_log as archive_log
from .archive import local_copy as local_copy
from .connect import connect as connect
from .connect import upgrade as upgrade
