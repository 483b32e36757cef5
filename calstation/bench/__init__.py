"""The virtual bench: a unit and a table that answer real protocols, and the truth that they follow.

It has its own mathematics and shares only constants, units and parameter names with the estimators.
"""
