from .page import HistoryPage as HistoryPage
