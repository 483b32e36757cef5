"""The engine process and the life cycle of a run: start, resumption, finalization and recovery at start-up.

Steps and motion are in `sequencer`. A run on a virtual bench uses the hooks of the bench.
"""

from calstation.runs.engine import INTERNAL, Engine
from calstation.runs.hooks import RunHooks, station_hooks
from calstation.runs.incomplete import StartupRecovery, close_incomplete_job, finish_incomplete, recover_at_startup
from calstation.runs.interrupted import Interrupted, find_chamber_left, find_interrupted, find_resumable
from calstation.runs.preparation import prepare
from calstation.runs.resume import Resumable, resumable_after, resumable_run
from calstation.runs.run import execute
from calstation.runs.start import Question, Role, RunStart, product_of
from calstation.runs.summary import RunSummary, run_summary
