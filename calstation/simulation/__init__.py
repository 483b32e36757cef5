"""Simulated runs, studies and recordings: everything that uses the virtual bench's truth or injects faults.

Production packages do not import it; a run gets its hooks from the window or the command line.
"""
