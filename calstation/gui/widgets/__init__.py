"""Widgets that several pages of the window share. Nothing here knows a run, a station or a device."""
