"""The frame of the window: the application, the main window with its pages and STOP, and the exchange of records.

What the pages share belongs in `calstation.gui.state`.
"""

from calstation.gui.shell.app import create_window, main
