from . import advice as advice
from .page import OperatorPage as OperatorPage
