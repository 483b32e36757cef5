"""The window: shows events and sends commands; no physics, no device, no thread of its own making."""
