"""The Quality page: control charts, capability, yield, check standards and repeatability.

`calstation.quality` computes the statistics; single runs are shown on the History page.
"""

from calstation.gui.quality.page import QualityPage
