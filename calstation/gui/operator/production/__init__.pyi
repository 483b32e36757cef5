from .badge_field import BadgeField as BadgeField
from .certificate_button import CertificateButton as CertificateButton
from .fixture_picture import FixturePicture as FixturePicture
from .label_button import LabelButton as LabelButton
from .shift_counter import ShiftCounter as ShiftCounter
