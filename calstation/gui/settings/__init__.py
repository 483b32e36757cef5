"""The Station page: station, links, site, table, profiles and their versions.

`config` checks and stores the files.
"""

from calstation.gui.settings.page import StationPage
