from . import advice as advice
from .figures import FiguresTable as FiguresTable
from .page import OperatorPage as OperatorPage
