"""Widgets of the operator page for a production line: badges, the shift counter, labels and certificates."""

from calstation.gui.operator.production.badge_field import BadgeField
from calstation.gui.operator.production.document_buttons import (
    CertificateButton,
    CertificatesButton,
    LabelButton,
    UnprintedNotice,
    label_void,
)
from calstation.gui.operator.production.shift_counter import ShiftCounter
