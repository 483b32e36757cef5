"""The 39-state navigation filter, its relinearisation and its observability analysis."""
