from .archive import LogCopy as LogCopy
from .archive import archive_log as archive_log
from .archive import local_copy as local_copy
from .connect import connect as connect
from .connect import upgrade as upgrade
from .remote import fetch_log as fetch_log
from .remote import fetch_result as fetch_result
from .remote import is_archived as is_archived
