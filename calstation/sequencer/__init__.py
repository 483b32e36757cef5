"""Runs steps, guards motion, keeps the journal, emits events."""
