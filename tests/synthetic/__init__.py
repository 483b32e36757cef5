"""Synthetic histories, many logs, and a station with a golden unit, for tests, the documentation and demonstrations."""
