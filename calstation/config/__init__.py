"""Station and product files: their checks, editing, versions and access, and the resolved configuration of a run.

Device profiles and log metadata do not belong here.
"""
