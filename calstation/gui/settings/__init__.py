"""The Station page, which edits the configuration files; `config` checks and stores them."""

from calstation.gui.settings.page import StationPage
