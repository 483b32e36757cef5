"""Studies, soak tests, fault plans and recordings, which use the true values of the virtual bench or inject faults.

Production packages do not import this package; they load it by name for a station with a section `[bench]`.
"""

from calstation.simulation.bench_recordings import GradeName, Kind, make_recording, record_on_bench, recordings_folder
from calstation.simulation.bench_settings import bench_config
from calstation.simulation.hooks import BenchHooks
from calstation.simulation.method_study import grades_of, run_method_study
from calstation.simulation.simulated_log import simulate_log
from calstation.simulation.soak_judge import RunEvaluation, judge_run
from calstation.simulation.soak_plan import STAGES as SHORT_STAGES
from calstation.simulation.soak_plan import PlannedRun, write_request
from calstation.simulation.soak_series import Soak, soak
from calstation.simulation.study import SEEDS, run_study
