from .badge_field import BadgeField as BadgeField
from .fixture_picture import FixturePicture as FixturePicture
from .label_button import LabelButton as LabelButton
from .shift_counter import ShiftCounter as ShiftCounter
