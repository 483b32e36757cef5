"""Table geometry from gravity at the rests agrees with the closed form and the independent truth of the bench."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.bench.truth import BenchTruth, TableTruth
from calstation.bench.truth.table import to_body
from calstation.config import load_configuration
from calstation.estimation.common import ImuModel, Posterior, Site, SolveContext, TableModel, stage_data
from calstation.estimation.positions import TABLE_QUANTITIES, TableRests, table_axes, table_rests
from calstation.physics import (
    COUNT,
    ORIENTATIONS,
    FloatArray,
    TableGeometry,
    orientation_matrix,
    rotation_matrix,
    rotation_vector,
)
from calstation.results import load_result, resolve
from calstation.simulation import bench_config
from calstation.simulation.study import draw_unit, simulate_stages, study_prior
from procedures import method
from tests.site_folder import SiteFolder

#: Outer and inner angle, °.
POSES = np.deg2rad([(o, i) for o in (0.0, 90.0, 180.0, -45.0) for i in (0.0, 90.0, 180.0, 225.0)])
#: The accelerometers of these rests are perfect, and the gyros are not used.
EXACT = Posterior(np.zeros(COUNT), np.zeros((COUNT, COUNT)))


def context(outer: tuple[float, ...] = (1.0, 0.0, 0.0), inner: tuple[float, ...] = (0.0, 0.0, 1.0)) -> SolveContext:
    imu = ImuModel("SN", 100.0, "rate", 1e-6, 1e-6, 1e-6, 1e-6)
    return SolveContext(Site(0.6, 0.0, 0.0), imu, TableModel(outer, inner))  # type: ignore[arg-type]


def rests(table: TableTruth, poses: FloatArray = POSES) -> TableRests:
    chain = table.chain()
    force = np.array([to_body(chain, float(outer), float(inner), table.up_force_n) for outer, inner in poses])
    return TableRests(force, poses, np.full(len(poses), 1e-10))


def truth_of(table: TableTruth) -> FloatArray:
    """Return non-orthogonality, and the tilt about x and y at home; the base tilt in n is rotated by the azimuth."""
    cosine, sine = np.cos(table.azimuth), np.sin(table.azimuth)
    east, north, _ = table.base_tilt
    return np.array([table.non_orthogonality, cosine * east - sine * north, sine * east + cosine * north])


AXES = [((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)), ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0))]


@pytest.mark.parametrize(("outer", "inner"), AXES)
def test_fit_of_exact_rests_is_exact_for_any_axes_azimuth_and_mounting(
    outer: tuple[float, float, float], inner: tuple[float, float, float]
) -> None:
    table = TableTruth(
        0.6,
        0.0,
        azimuth=0.7,
        base_tilt=(1e-3, -2e-3, 0.0),
        outer_axis=outer,
        inner_axis=inner,
        non_orthogonality=3e-4,
        mount=(0.01, -0.02, 0.3),
    )
    found = table_axes([rests(table)], context(outer, inner), EXACT)
    assert [found[name].value for name in TABLE_QUANTITIES] == pytest.approx(truth_of(table), abs=1e-7)


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_fit_is_in_platform_axes_for_any_orientation_of_the_unit(orientation: str) -> None:
    turned = orientation_matrix(orientation)
    mount = rotation_vector(rotation_matrix(np.array([0.01, -0.02, 0.03])) @ np.array(turned))
    table = TableTruth(0.6, 0.0, azimuth=0.7, base_tilt=(1e-3, -2e-3, 0.0), non_orthogonality=3e-4, mount=tuple(mount))
    nominal = context()
    unit = replace(nominal, table=replace(nominal.table, orientation=turned))
    found = table_axes([rests(table)], unit, EXACT)
    assert [found[name].value for name in TABLE_QUANTITIES] == pytest.approx(truth_of(table), abs=1e-7)


def test_orthogonality_equals_the_estimate_from_two_opposite_pairs_of_rests() -> None:
    """The orthogonality error is half the change of tilt along the outer axis with the inner axis up and down."""
    table = TableTruth(0.6, 0.0, non_orthogonality=2e-4)
    poses = np.deg2rad([(o, i) for o in (0.0, 180.0) for i in (0.0, 90.0, 180.0, 270.0)])
    measured = rests(table, poses)
    up, down = (
        np.mean([np.cos(i) * f[0] - np.sin(i) * f[1] for f, (_, i) in zip(half, angles, strict=True)]) / 9.8
        for half, angles in ((measured.force[:4], poses[:4]), (measured.force[4:], poses[4:]))
    )
    found = table_axes([measured], context(), EXACT)
    assert abs(up - down) / 2.0 == pytest.approx(abs(found["orthogonality"].value), rel=2e-3)


def test_only_quantities_determined_by_the_rests_are_estimated() -> None:
    table = TableTruth(0.6, 0.0)
    one_axis = np.deg2rad([(0.0, float(i)) for i in range(0, 360, 30)])
    assert set(table_axes([rests(table, one_axis)], context(), EXACT)) == {"tilt_x"}  # the inner axis remains upright
    assert table_axes([rests(table, POSES[:3])], context(), EXACT) == {}
    assert table_axes([], context(), EXACT) == {}


def test_sigmas_grow_with_the_scatter_if_the_encoder_sigma_is_too_small() -> None:
    random, table = np.random.default_rng(1), TableTruth(0.6, 0.0)
    exact = rests(table)
    wrong = TableRests(exact.force, POSES + 0.01 * random.standard_normal(POSES.shape), exact.variance)
    assert table_axes([wrong], context(), EXACT)["tilt_x"].sigma > 5.0 * (
        table_axes([exact], context(), EXACT)["tilt_x"].sigma
    )


def fitted(grade: str, seed: int, stages: list[str]) -> tuple[BenchTruth, FloatArray, FloatArray]:
    """Return truth, errors and sigmas of a simulated calibration."""
    truth, setup = draw_unit(grade, seed, "estimated", instability=True)  # type: ignore[arg-type]
    posterior, found = study_prior(truth.grade, "estimated"), []
    data = simulate_stages(truth, seed, stages, {})
    for stage in stages:
        chosen = method(stage)
        solver = chosen.solver(setup, posterior, chosen.schedule())
        solver.feed(data[stage])
        posterior = solver.finish().posterior
        found.append(table_rests(stage_data([data[stage]], setup.imu), setup, posterior))
    values = table_axes(found, setup, posterior)
    error = np.array([values[name].value for name in TABLE_QUANTITIES]) - truth_of(truth.table)
    return truth, error, np.array([values[name].sigma for name in TABLE_QUANTITIES])


@pytest.mark.long
@pytest.mark.parametrize(
    ("grade", "stages"),
    [("mems", ["rate", "six_position"]), pytest.param("nav", ["six_position"], marks=pytest.mark.exhaustive)],
)
def test_errors_of_complete_calibrations_agree_with_their_sigmas(grade: str, stages: list[str]) -> None:
    scores = np.array([error / sigma for _, error, sigma in (fitted(grade, seed, stages) for seed in range(20))])
    assert np.abs(scores).max() < 4.0
    assert 0.4 < np.sqrt(np.mean(scores**2)) < 1.3


def test_default_table_and_bench_have_the_same_home_orientation() -> None:
    assert TableGeometry().outer_axis == TableTruth(0.0, 0.0).outer_axis


@pytest.mark.long
def test_run_and_re_solved_log_give_the_same_table_geometry(site_folder: SiteFolder) -> None:
    ended = site_folder.run("rate", "six_position")
    result = load_result(Path(ended.result_file))
    assert set(result.table) == set(TABLE_QUANTITIES)
    truth = BenchConfig.model_validate(bench_config(load_configuration(site_folder.request()))).truth()
    for value, true in zip(result.table.values(), truth_of(truth.table), strict=True):
        assert abs(value.value - true) < 4.0 * value.sigma
    assert resolve(Path(ended.log)).result.table == result.table
