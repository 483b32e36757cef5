"""The graphical user interface: shows events and sends commands; no physics, device access or threads."""

from calstation.gui.shell import create_window

__all__ = ["create_window"]
