from .process import PipeReader as PipeReader
from .process import spawn_process as spawn_process
from .queue import Job as Job
from .queue import JobQueue as JobQueue
from .queue import ProgressCallback as ProgressCallback
