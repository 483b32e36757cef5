"""The window: shows events and sends commands; no physics, no device, no thread of its own making."""

from calstation.gui.shell import create_window

__all__ = ["create_window"]
