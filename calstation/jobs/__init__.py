"""Background jobs of the window, with progress, in a process that can be killed; runs use a separate engine."""

from calstation.jobs.process import ChildProcess, deferred_signals, receive_stop_signals
from calstation.jobs.queue import Job, JobQueue, ProgressCallback
from calstation.jobs.signals import STOP_SIGNALS, on_stop_signals
