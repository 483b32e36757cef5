from . import advice as advice
from .page import OperatorPage as OperatorPage
from .verdict import FiguresTable as FiguresTable
