"""The application and its main window; code shared by the pages belongs in `calstation.gui.state`."""

from calstation.gui.shell.app import create_window, main
