"""Code that all solvers share: samples, rests, noise, alignment and least squares."""

from calstation.estimation.common.alignment import (
    AMBIGUOUS_AZIMUTH_SIGMA,
    FREE_AZIMUTH_SIGMA,
    Start,
    align_vertical,
    start_tests,
    starts,
)
from calstation.estimation.common.by_position import (
    EXCESSIVE,
    NOTABLE,
    LocalScores,
    PositionResidual,
    ScoreFunction,
    StageResiduals,
    concentration,
    position_residuals,
)
from calstation.estimation.common.context import (
    NORMAL_GRAVITY_SIGMA,
    ImuModel,
    Posterior,
    Secondary,
    Site,
    SolveContext,
    StoredCrossCalibration,
    TableModel,
)
from calstation.estimation.common.gravity import gravity_sensitivity, with_gravity, without_gravity
from calstation.estimation.common.latitude import LatitudeEstimate, RestOutput, resolves_earth_rate
from calstation.estimation.common.least_squares import (
    BatchGain,
    Consistency,
    chi_square_quantile,
    consider_update,
    gauss_newton,
    map_estimate,
    nis_consistency,
)
from calstation.estimation.common.model_test import Diagnosis, ModelTest, stage_agreement
from calstation.estimation.common.noise import (
    BIAS_DRIFT_PER_INSTABILITY,
    BIAS_DRIFT_TIME,
    RestNoise,
    filter_noise,
    noise_tests,
    rest_force,
    rest_mean_variance,
    rest_noise,
    rest_weights,
    with_measured_noise,
)
from calstation.estimation.common.planned import PlannedSamples, profile
from calstation.estimation.common.residuals import CREEP, RestResiduals, compensated_means, rest_residuals
from calstation.estimation.common.samples import (
    LARGEST_VALUE,
    SampleBlock,
    blocks_from,
    has_gyros,
    join_blocks,
    snap_angles,
)
from calstation.estimation.common.sequence import (
    SEQUENCE_MODULI,
    AngleUnwrapper,
    SequenceError,
    SequenceUnwrapper,
    unwrap_counter,
)
from calstation.estimation.common.stage import (
    BIAS_SIGMAS,
    REST_MARGIN,
    REST_RATE,
    REST_WINDOW,
    SHORTEST_REST,
    StageBuffer,
    StageData,
    find_rests,
    group_means,
    mean_angles,
    means,
    no_rest_error,
    row_maxima,
    sensor_rates,
    slope_weights,
    stage_data,
    true_intervals,
    window_mean,
)
from calstation.estimation.common.stillness import Link, Stillness, find_stillness
from calstation.estimation.common.temperature_model import TemperatureModel
