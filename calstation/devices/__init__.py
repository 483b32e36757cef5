"""Drivers for tables and IMUs, register maps and their transfer."""
