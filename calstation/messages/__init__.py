"""The message catalogue: every error, event, finding and term that a person reads, in English and Chinese.

Code elsewhere handles codes and values and never a sentence. Nothing here knows Qt, devices or files of a run.
"""
