from . import advice as advice
from .page import OperatorPage as OperatorPage
from .production import CertificateButton as CertificateButton
from .production import LabelButton as LabelButton
from .verdict import FiguresTable as FiguresTable
