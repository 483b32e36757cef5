"""The Station page, which edits the configuration files; `config` checks and stores the files."""

from calstation.gui.settings.page import StationPage
