"""Deviations in sigmas keep the false alarm rate when runs of several schedules are mixed."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from scipy import stats

from calstation.config import library, load_product
from calstation.devices.profiles import load_imu_profile
from calstation.physics import NAMES, FloatArray
from calstation.quality import (
    BASELINE,
    ParameterQuality,
    Process,
    RandomEffects,
    nelson_signals,
    random_effects,
    summarise_quality,
)
from calstation.records import IndexedRun, RunIndex, RunRecord, Verdict

BEGIN = datetime(2026, 1, 1, tzinfo=UTC)
#: Sigmas of the two schedules, which take turns, relative to the spread between units.
SIGMAS = np.array([0.5, 1.5])

#: BCG vaccine against tuberculosis: log risk ratios of 13 trials and their variances (Colditz et al., 1994; data set
#: `dat.bcg` of the R package metafor, which estimates tau² = 0.3181 by Paule and Mandel).
BCG = np.array(
    [
        (-0.8893, 0.3256),
        (-1.5854, 0.1946),
        (-1.3481, 0.4154),
        (-1.4416, 0.0200),
        (-0.2175, 0.0512),
        (-0.7861, 0.0069),
        (-1.6209, 0.2230),
        (0.0120, 0.0040),
        (-0.4694, 0.0564),
        (-1.3713, 0.0730),
        (-0.3394, 0.0124),
        (0.4459, 0.5325),
        (-0.0173, 0.0714),
    ]
)


def test_random_effects_agree_with_a_published_study() -> None:
    found = random_effects(BCG[:, 0], np.sqrt(BCG[:, 1]))
    assert (found.between**2, found.mean) == pytest.approx((0.3181, -0.715), abs=5e-4)
    assert float(np.sum(found.scores(BCG[:, 0], np.sqrt(BCG[:, 1])) ** 2)) == pytest.approx(12.0)


def test_random_effects_agree_with_known_variances() -> None:
    random = np.random.default_rng(2)
    sigmas = 1e-6 * np.resize(SIGMAS, 200)
    found = [random_effects(random.normal(3e-6, np.hypot(sigmas, 2e-6)), sigmas) for _ in range(300)]
    assert np.mean([each.between**2 for each in found]) == pytest.approx(4e-12, rel=0.03)
    assert np.mean([each.mean for each in found]) == pytest.approx(3e-6, rel=0.03)
    assert random_effects(np.array([1.0, 1.1, 0.9]), np.ones(3)) == RandomEffects(pytest.approx(1.0), 0.0)


def store(folder: Path, product: str, values: FloatArray, sigmas: FloatArray, serial: str | None = None) -> None:
    """Store runs of different units, or of one unit, one hour apart; both arrays have shape (n, 30)."""
    runs = []
    for k, (value, sigma) in enumerate(zip(values.tolist(), sigmas.tolist(), strict=True)):
        name = f"{serial or 'SN'}_{k}"
        record = RunRecord(
            serial=serial or f"SN-{k}",
            started_utc=(BEGIN + timedelta(hours=k)).isoformat(),
            verdict=Verdict.PASSED,
            attempt=1,
            product=product,
            station="bench 1",
            operator="Li Wei",
            stages=(),
            log=Path(f"{name}.h5"),
            result=None,
            duration=1.0,
        )
        of_run = (dict(zip(NAMES, row, strict=True)) for row in (value, sigma))
        runs.append(IndexedRun(name, "stamp", record, *of_run))
    RunIndex(folder).update(runs)


def alarms_per_1000(parameters: tuple[ParameterQuality, ...], first: int = BASELINE) -> float:
    """Return the signals of rule 1 per 1000 values after the baseline, over all parameters as independent series."""
    signals = [each.charts().signals()["nelson_1"] for each in parameters]
    count = sum(int(np.count_nonzero(found >= first)) for found in signals)
    return 1000.0 * count / sum(len(each.values) - first for each in parameters)


@pytest.fixture
def mixed() -> tuple[FloatArray, FloatArray]:
    """Values of 2000 units with mean 5 and standard deviation 1, and sigmas of the schedules."""
    sigmas = np.repeat(np.resize(SIGMAS, 2000)[:, None], len(NAMES), axis=1)
    return np.random.default_rng(6).normal(5.0, np.hypot(1.0, sigmas)), sigmas


def test_units_of_two_schedules_keep_the_false_alarm_rate(tmp_path: Path, mixed: tuple[FloatArray, FloatArray]) -> None:
    values, sigmas = mixed
    name = load_product(library.find("products", "nav_a"))[1].name
    store(tmp_path, name, values, sigmas)
    found = summarise_quality(lambda *_: None, tmp_path, library.find("products", "nav_a"), relative=True)
    assert len(found.parameters) == len(NAMES) + 1, "and the mean of the accelerometer scale factors"
    assert alarms_per_1000(found.parameters) == pytest.approx(1000 / 370, rel=0.35)
    effects = [each.effects for each in found.parameters if each.parameter in NAMES]
    assert np.mean([each.between**2 for each in effects if each is not None]) == pytest.approx(1.0, rel=0.15)
    (row, *_) = found.to_json()["parameters"]
    assert (row["limits_from"], row["center_from"], row["baseline"]) == ("baseline", "baseline", BASELINE)
    assert row["between_units"]["mean"] == pytest.approx(5.0, abs=0.5)

    naive = [(column - 5.0) / sigma for column, sigma in zip(values.T, sigmas.T, strict=True)]
    rule_1 = [nelson_signals(each, 0.0, Process.estimated(each).sigma).count(1) for each in naive]
    assert 1000.0 * sum(rule_1) / values.size > 6.0, "the deviation over the run's sigma alone is not comparable"


def test_check_standard_in_two_schedules_keeps_the_false_alarm_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """True values differ from the references by reference errors and expected drift, independently per parameter."""
    random = np.random.default_rng(8)
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    text = library.find("products", "nav_a").read_text(encoding="utf-8")
    imu = load_imu_profile(library.find("imus", load_product(library.find("products", "nav_a"))[1].imu))
    change = imu.change_sigmas(0.0)
    sigmas = change * np.resize(2.0 * SIGMAS, 1000)[:, None]
    reference = random.normal(0.0, change)
    error = np.hypot(change, 0.5 * change) * stats.norm.ppf((random.permutation(len(NAMES)) + 0.5) / len(NAMES))
    rows = {name: {"value": reference[k], "sigma": 0.5 * change[k]} for k, name in enumerate(NAMES)}
    standard = {"serial": "GOLD", "interval_days": 7, "reference": rows}
    product = tmp_path / "nav.toml"
    product.write_text(text + tomli_w.dumps({"check_standards": [standard]}), encoding="utf-8")
    name = load_product(product)[1].name
    store(tmp_path, name, random.normal(reference + error, sigmas), sigmas, "GOLD")

    found = summarise_quality(lambda *_: None, tmp_path, product, "GOLD", relative=True).single_unit
    assert {(each.process, each.declared) for each in found} == {(Process(0.0, 1.0), True)}
    assert alarms_per_1000(found, 0) == pytest.approx(2.7, rel=0.4)
    scores = np.array([each.values for each in found])
    assert np.mean(scores**2) == pytest.approx(1.0, rel=0.15)
    (row, *_) = summarise_quality(lambda *_: None, tmp_path, product, "GOLD", relative=True).to_json()["golden"][
        "parameters"
    ]
    assert (row["limits_from"], row["center_from"], row["center"]) == ("stated", "reference", 0.0)

    (bias,) = summarise_quality(lambda *_: None, tmp_path, product, "GOLD", "gyro_bias_x").single_unit
    assert (bias.process.center, bias.declared) == (reference[NAMES.index("gyro_bias_x")], True)
    assert bias.process.baseline == BASELINE
    (unknown,) = summarise_quality(
        lambda *_: None, tmp_path, library.find("products", "nav_a"), "GOLD", "gyro_bias_x", relative=True
    ).single_unit
    assert not unknown.declared
    assert unknown.effects is not None
