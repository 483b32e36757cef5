from . import advice as advice
from .figures import FiguresTable as FiguresTable
from .figures import clear as clear
from .page import OperatorPage as OperatorPage
