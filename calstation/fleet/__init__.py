"""Many logs at once: solving them again on many cores, and comparing the solutions of two versions."""
