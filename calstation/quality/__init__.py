"""Quality over time: control charts, capability, yield and measurement system analysis of stored runs."""

from calstation.quality.capability import Interval, capability
from calstation.quality.charts import (
    BASELINE,
    RULES,
    CusumChart,
    EwmaChart,
    Process,
    cusum_chart,
    ewma_chart,
    individuals_chart,
    nelson_signals,
)
from calstation.quality.gauge import (
    ACCEPTABLE,
    MARGINAL,
    MIN_CATEGORIES,
    AnovaRow,
    GaugeStudy,
    Variation,
    gauge_study,
    range_limits,
    ranges_beyond,
)
from calstation.quality.gauge_plan import GaugePlan, Measurement, StudyState, evaluate_study
from calstation.quality.gravity_shift import COMMON_SCALE, GravityShift, common_step, gravity_shift
from calstation.quality.runs import SimulatedRuns, first_of_each_unit, judged_runs, last_of_each_unit
from calstation.quality.standards import (
    InstrumentState,
    StandardProblem,
    StandardState,
    due_certificates,
    instrument_state,
    judge_result,
    overdue_instruments,
    require_standards,
    standard_states,
)
from calstation.quality.station import StandardHistory, StationQuality, station_quality
from calstation.quality.summary import (
    MIN_VALUES,
    Charts,
    ParameterQuality,
    QualitySummary,
    RandomEffects,
    limit_interval,
    random_effects,
    summarise_quality,
)
from calstation.quality.table_chart import WEIGHT, WIDTH, TableChart, alarms, table_charts
from calstation.quality.yields import FailedCheck, Share, Yields, count_yields
