"""The unit's processor and its protocols, and faults of its stream."""
