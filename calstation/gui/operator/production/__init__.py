"""Additions to the operator page for a production line: badges, the shift counter, labels and certificates."""

from calstation.gui.operator.production.badge_field import BadgeField
from calstation.gui.operator.production.certificate_button import CertificateButton
from calstation.gui.operator.production.label_button import LabelButton
from calstation.gui.operator.production.shift_counter import ShiftCounter
