from .page import HistoryPage as HistoryPage
from .run_table import local_time as local_time
