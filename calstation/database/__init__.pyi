from .connect import connect as connect
from .connect import upgrade as upgrade
