"""The graphical user interface, which shows events and sends commands, without physics, device access or threads."""

from calstation.gui.shell import create_window

__all__ = ["create_window"]
