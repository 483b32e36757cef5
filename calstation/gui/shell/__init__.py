"""The application and its main window; code that the pages share belongs in `calstation.gui.state`."""

from calstation.gui.shell.app import create_window

__all__ = ["create_window"]
