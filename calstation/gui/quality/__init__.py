"""The Quality page: control charts, capability, yield, check standards and repeatability over many runs.

Statistics are computed in `calstation.quality`; single runs are shown on the History page.
"""

from calstation.gui.quality.page import QualityPage
