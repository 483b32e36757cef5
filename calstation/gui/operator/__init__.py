"""The operator page: loading, scan, START, live view and verdict; the run status is in `calstation.gui.state`."""

from calstation.gui.operator import advice
from calstation.gui.operator.page import OperatorPage
from calstation.gui.operator.production import CertificateButton, LabelButton
from calstation.gui.operator.questions import StartDialog
from calstation.gui.operator.units import SlotsPanel
from calstation.gui.operator.verdict import FiguresTable
