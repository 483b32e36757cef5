from .filters import Filters as Filters
from .page import HistoryPage as HistoryPage
