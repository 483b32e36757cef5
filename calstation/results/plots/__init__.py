"""Jobs that compute plot data; the GUI draws them."""

from calstation.results.plots.allan import FLOOR, AllanCurve, AllanDeviation, allan_deviation, longest_rest
from calstation.results.plots.compensation import (
    Applied,
    ImuOutput,
    apply_to_recording,
    before_and_after,
    read_recording,
)
from calstation.results.plots.index import LogIndex, StageSpan, log_index, samples
from calstation.results.plots.method_solution import (
    GimbalAxis,
    GimbalPlotData,
    MethodSolution,
    PositionPlotData,
    gimbal_plot_data,
    solve_method,
)
from calstation.results.plots.min_max_pyramid import (
    BINS,
    CHANNELS,
    Columns,
    MinMaxPyramid,
    Values,
    bins_per_column,
    merge_columns,
)
from calstation.results.plots.pairs import PairPlotData, PairResiduals, SecondaryPlotData, StoredPairFile, stored_pairs
