"""The operator page: loading, scan, START, live view and verdict; `calstation.gui.state` contains the run's status."""

from calstation.gui.operator import advice
from calstation.gui.operator.live import LiveView
from calstation.gui.operator.page import OperatorPage
from calstation.gui.operator.production import CertificateButton, LabelButton, UnprintedNotice
from calstation.gui.operator.questions import StartDialog, ask
from calstation.gui.operator.units import SlotsPanel
from calstation.gui.operator.verdict import FiguresTable
