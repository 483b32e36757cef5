"""The graphical user interface, which shows events and sends commands, without physics, device access or threads."""

from calstation.gui.start import create_window, main

__all__ = ["create_window", "main"]
