"""The engineer page."""
