"""Check standards: tests of a run against the reference, due dates, and refused production."""

import json
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from scipy import stats
from synthetic.golden import golden_run, golden_unit

from calstation.bench import BenchConfig
from calstation.cli.app import run_app
from calstation.config import CheckStandardSection, library, load_configuration, site_folder
from calstation.devices.profiles import ImuProfile, load_imu_profile
from calstation.errors import ConfigurationError
from calstation.estimation.common import Posterior
from calstation.judgement import FALSE_ALARM, POWER, judge_standard
from calstation.physics import COUNT, NAMES, PARAMETERS, FloatArray
from calstation.quality import (
    due_certificates,
    instrument_state,
    judge_result,
    overdue_instruments,
    standard_states,
)
from calstation.records import InstrumentSection, audit_path, open_log, read_audit
from calstation.results import History, load_result
from calstation.runs import finalize, prepare
from calstation.sequencer import Control, Message
from calstation.simulation import bench_config
from tests.helpers import raises_code
from tests.site_folder import SiteFolder

NOW = datetime(2026, 11, 23, tzinfo=UTC)
#: Parameters that belong to the unit.
OF_THE_UNIT = [p.name for p in PARAMETERS if p.group != "outer_lever"]


@pytest.fixture(scope="module")
def stable() -> ImuProfile:
    """A profile of units without drift."""
    never = {"power_up": 0.0, "year": 0.0}
    profile = load_imu_profile(library.find("imus", "bench_mems"))
    groups = {p.group: never for p in PARAMETERS}
    return ImuProfile.model_validate({**profile.model_dump(exclude_unset=True), "stability": groups})


def standard(values: FloatArray, sigma: float | FloatArray = 0.0, **more: Any) -> CheckStandardSection:
    sigmas = np.broadcast_to(sigma, COUNT).tolist()
    rows = zip(NAMES, values.tolist(), sigmas, strict=True)
    reference = {name: {"value": value, "sigma": each} for name, value, each in rows}
    return CheckStandardSection.model_validate({"serial": "G", "interval_days": 7, "reference": reference, **more})


def random_covariance(random: np.random.Generator) -> FloatArray:
    """Return a covariance with strong correlations and sigmas over five decades."""
    mixed = random.standard_normal((COUNT, 12)) @ random.standard_normal((12, COUNT)) + 0.3 * np.eye(COUNT)
    scale = 10.0 ** random.uniform(-6.0, -1.0, COUNT)
    covariance = mixed @ mixed.T
    size = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(size, size) * np.outer(scale, scale))


@pytest.mark.long
def test_t_squared_of_correct_runs_is_chi_squared_with_the_stated_alarm_rate(stable: ImuProfile) -> None:
    random, verdicts = np.random.default_rng(7), []
    for _ in range(40):
        covariance = random_covariance(random)
        true = random.standard_normal(COUNT)
        runs = random.multivariate_normal(true, covariance, size=250, method="cholesky")
        known = standard(true)
        verdicts += [judge_standard(known, stable, NOW, Posterior(run, covariance), NAMES) for run in runs]
    t_squared = np.array([verdict.t_squared for verdict in verdicts])
    assert verdicts[0].degrees == len(OF_THE_UNIT) == 27
    assert stats.kstest(t_squared, stats.chi2(27).cdf).pvalue > 0.01
    errors = np.array([list(verdict.e_n.values()) for verdict in verdicts]).ravel()
    assert stats.kstest(errors[:: 27 * 3 + 1], stats.norm(scale=0.5).cdf).pvalue > 0.01
    failed = sum(not verdict.passed for verdict in verdicts)
    assert failed <= stats.binom.ppf(0.999, len(verdicts), FALSE_ALARM)


def test_detectable_error_is_detected_with_the_stated_probability(stable: ImuProfile) -> None:
    """Monte Carlo: run and reference are drawn around true values that differ by the detectable error."""
    random, runs, name = np.random.default_rng(11), 1500, "accel_bias_y"
    covariance, at = random_covariance(random), NAMES.index(name)
    sigma = 0.7 * np.sqrt(np.diag(covariance))
    true = random.standard_normal(COUNT)
    once = judge_standard(standard(true, sigma), stable, NOW, Posterior(true, covariance), NAMES)
    assert once.detectable.keys() == once.e_n.keys()
    moved = true.copy()
    moved[at] += once.detectable[name]
    found = random.multivariate_normal(moved, covariance, size=runs, method="cholesky")
    references = random.normal(true, sigma, (runs, COUNT))
    verdicts = [
        judge_standard(standard(reference, sigma), stable, NOW, Posterior(run, covariance), NAMES)
        for run, reference in zip(found, references, strict=True)
    ]
    detected = sum(abs(verdict.e_n[name]) > verdict.e_n_limit for verdict in verdicts)
    low, high = stats.binom.interval(0.999, runs, POWER)
    assert low <= detected <= high


def test_normalised_error_and_t_squared_match_a_hand_calculation(stable: ImuProfile) -> None:
    """|x - ref| = 5 mm, sigmas 3 and 4 mm: E_n = 5 / (2 sqrt(9 + 16)) = 0.5, and T2 = 1."""
    known = CheckStandardSection.model_validate(
        {"serial": "G", "interval_days": 7, "reference": {"inner_lever_x": {"value": 0.1, "sigma": 0.004}}}
    )
    mean, covariance = np.zeros(COUNT), np.zeros((COUNT, COUNT))
    at = NAMES.index("inner_lever_x")
    mean[at], covariance[at, at] = 0.105, 0.003**2
    verdict = judge_standard(known, stable, NOW, Posterior(mean, covariance), NAMES)
    assert verdict.e_n == {"inner_lever_x": pytest.approx(0.5)}
    assert verdict.t_squared == pytest.approx(1.0)
    assert verdict.e_n_limit == pytest.approx(0.5 * stats.norm.isf(0.25 * FALSE_ALARM))
    assert verdict.t_squared_limit == pytest.approx(stats.chi2.isf(0.5 * FALSE_ALARM, 1))
    shift = verdict.detectable["inner_lever_x"] / 0.005  # of the noncentral normal distribution, in sigmas
    edge = stats.norm.isf(0.25 * FALSE_ALARM)
    assert stats.norm.sf(edge - shift) + stats.norm.cdf(-edge - shift) == pytest.approx(POWER, abs=1e-9)
    mean[at] = 0.1 + 2.0 * 0.005 * 1.01 * verdict.e_n_limit
    assert not judge_standard(known, stable, NOW, Posterior(mean, covariance), NAMES).passed
    assert not judge_standard(known, stable, NOW, Posterior(mean, covariance), ["gyro_bias_x"]).passed


def test_reference_uncertainty_includes_drift_and_excludes_the_mounting() -> None:
    imu = load_imu_profile(library.find("imus", "bench_mems"))
    true, small = np.zeros(COUNT), 1e-18 * np.eye(COUNT)
    changed = 4.0 * imu.change_sigmas(1.0)
    changed[[name.startswith("outer_lever") for name in NAMES]] = 100.0
    run = Posterior(changed, small)
    fresh = judge_standard(standard(true, date=NOW.date()), imu, NOW, run, NAMES)
    aged = judge_standard(standard(true, date=NOW.date() - timedelta(days=365)), imu, NOW, run, NAMES)
    assert aged.e_n["gyro_bias_x"] == pytest.approx(2.0, rel=1e-3)  # 4 sigma of the change
    assert fresh.e_n["gyro_bias_x"] >= aged.e_n["gyro_bias_x"]
    assert "outer_lever_x" not in fresh.e_n


@pytest.mark.exhaustive
def test_t_squared_of_simulated_runs_of_many_units_is_chi_squared(stable: ImuProfile) -> None:
    """Many units are needed, because the prior of the solver describes the grade and not a single unit."""
    found = []
    for unit in range(60):
        true, run = golden_unit(unit)[0].parameters, golden_run(0, unit)
        found.append(judge_standard(standard(true), stable, NOW, run.posterior, run.estimated))
    t_squared = [verdict.t_squared for verdict in found]
    assert stats.kstest(t_squared, stats.chi2(found[0].degrees).cdf).pvalue > 0.01
    moved = true.copy()
    moved[0] += 12.0 * run.posterior.sigma[0]
    worst = judge_standard(standard(moved), stable, NOW, run.posterior, run.estimated)
    assert not worst.passed
    assert max(worst.e_n, key=lambda name: abs(worst.e_n[name])) == NAMES[0]


@pytest.mark.long
def test_check_standard_runs_agree_with_a_reference_from_earlier_runs(stable: ImuProfile) -> None:
    runs = [golden_run(number, 3) for number in range(40)]
    earlier = [run.posterior.mean for run in runs[:10]]
    known = standard(np.mean(earlier, axis=0), np.std(earlier, axis=0, ddof=1) / np.sqrt(10.0))
    verdicts = [judge_standard(known, stable, NOW, run.posterior, run.estimated) for run in runs[10:]]
    assert sum(not verdict.passed for verdict in verdicts) <= 1  # E_n has a probability of 5 % beyond its limit


GOLDEN = "SN-000001"
STAGES = ("rate", "six_position")


@pytest.fixture
def site(site_folder: SiteFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SiteFolder:
    """A station whose product has a check standard with the true values of the bench as reference."""
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    write(site_folder)
    return site_folder


def write(site: SiteFolder, interval_days: float = 7.0, off: float = 0.0) -> None:
    """Write the product; `off` is the error of the reference gyro scale factors, equivalent to a station error."""
    site.write({"stages": list(STAGES)})
    request = replace(site.request(), serial=GOLDEN)
    true = BenchConfig.model_validate(bench_config(load_configuration(request))).truth().parameters
    solved = [p.name for p in PARAMETERS if p.group in ("gyro_scale", "gyro_misalign", "accel_bias", "accel_misalign")]
    reference = {
        name: {"value": float(true[NAMES.index(name)]) + (off if name == "gyro_scale_x" else 0.0), "sigma": 0.0}
        for name in solved
    }
    standards = [{"serial": GOLDEN, "interval_days": interval_days, "reference": reference}]
    site.write({"stages": list(STAGES), "check_standards": standards})


def refused(site: SiteFolder, code: str, **changes: Any) -> ConfigurationError:
    with raises_code(ConfigurationError, code) as caught:
        prepare(replace(site.request(), **changes), site.events.append, Control())
    assert isinstance(caught.value, ConfigurationError)
    return caught.value


def allowed(site: SiteFolder, **changes: Any) -> str | None:
    """Prepare a run; return the override in the configuration of its log."""
    meta, _ = prepare(replace(site.request(), **changes), site.events.append, Control())[0].meta(None)
    assert meta.run is not None
    return meta.run.standard_override


@pytest.mark.long
def test_production_requires_a_passed_check_standard(site: SiteFolder, capsys: pytest.CaptureFixture[str]) -> None:
    assert refused(site, "quality.standard_never").values["name"] == GOLDEN
    assert allowed(site, serial=GOLDEN) is None

    request = replace(site.request(), serial=GOLDEN)
    site.request = lambda *stages, **more: request  # type: ignore[method-assign,assignment]
    ended = site.run()
    assert ended.verdict.passed
    del site.request  # type: ignore[method-assign]
    result = load_result(Path(ended.result_file))
    assert result.check_standard is not None
    assert result.check_standard.passed
    assert {"gyro_scale_x", "accel_bias_z"} <= set(result.check_standard.e_n)
    assert result.registers is not None
    assert result.registers.new is None  # a check standard is never adjusted
    assert "standard_agrees" in [event.id for event in site.events_of(Message)]
    assert result.check_standard == open_result(ended.log).check_standard

    assert allowed(site) is None
    history = site_history(site)
    setup = load_configuration(site.request())
    again = judge_result(setup.product.check_standards[0], setup.imu, result)
    assert again.t_squared == pytest.approx(result.check_standard.t_squared, rel=1e-6)
    (state,) = standard_states(setup.station, setup.product, history, datetime.now(UTC))
    assert state.problem is None
    assert state.due == datetime.fromisoformat(result.started_utc or "") + timedelta(days=7)
    later = datetime.now(UTC) + timedelta(days=8)
    elsewhere = setup.station.model_copy(update={"name": "another station"})
    for station, reason in ((setup.station, "overdue"), (elsewhere, "never")):
        (state,) = standard_states(station, setup.product, history, later)
        assert state.problem is not None
        assert state.problem.reason == reason

    files = ["--station", str(site.station), "--product", str(site.product), "--out", str(site.folder / "runs")]
    assert run_app(["quality", "standards", *files, "--json", "-"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert [row["serial"] for row in shown["standards"]] == [GOLDEN]
    assert shown["standards"][0]["wrong"] is None

    write(site, interval_days=1e-6)
    refused(site, "quality.standard_overdue")
    assert run_app(["run", *files, "--serial", "SN-000042"]) == ConfigurationError.exit_code
    assert "--override-standard" in capsys.readouterr().err
    assert run_app(["quality", "standards", *files]) == 1

    write(site, off=0.1)  # the last run disagrees with the reference as it is now
    refused(site, "quality.standard_out")
    refused(site, "quality.no_reason", override_standard=" ")
    assert allowed(site, serial=GOLDEN) is None
    request = replace(site.request(), override_standard="golden unit at the laboratory")
    site.request = lambda *stages, **more: request  # type: ignore[method-assign,assignment]
    made = load_result(Path(site.run().result_file))
    assert made.standard_override == "golden unit at the laboratory"
    assert made.standard_override_by == ["tester"]
    assert [(each.reason, each.name) for each in made.standard_overridden] == [("out", GOLDEN)]
    assert made.check_standard is None
    event = read_audit(audit_path(site_folder())).entries[-1]
    assert (event.event, event.by, event.why) == ("standard_overridden", "tester", "golden unit at the laboratory")
    assert event.values["overridden"] == [f"out {GOLDEN}"]


@pytest.mark.long
def test_check_standard_that_disagrees_with_its_reference_stops_production(site: SiteFolder) -> None:
    write(site, off=0.01)
    request = replace(site.request(), serial=GOLDEN)
    site.request = lambda *stages, **more: request  # type: ignore[method-assign,assignment]
    ended = site.run()
    del site.request  # type: ignore[method-assign]
    assert ended.verdict == "failed"
    result = load_result(Path(ended.result_file))
    assert result.check_standard is not None
    assert not result.check_standard.passed
    assert "standard_differs" in [event.id for event in site.events_of(Message)]
    refused(site, "quality.standard_out")


@pytest.mark.long
def test_check_standard_run_that_ends_early_is_marked_in_its_result(site_folder: SiteFolder) -> None:
    reference = {"accel_scale_x": {"value": 0.0, "sigma": 1.0}}
    standards = [{"serial": "SN-000042", "interval_days": 7.0, "reference": reference}]
    entries = {"end_on_failure": True, "stages": ["six_position", "azimuth_flip"], "check_standards": standards}
    site_folder.write(entries, out_of_limits=True)
    assert site_folder.request().serial == "SN-000042"
    result = load_result(Path(site_folder.run().result_file))
    assert (result.outcome, result.stages) == ("failed", ["six_position"])
    assert result.check_standard is not None
    (run,) = site_history(site_folder).runs()
    assert run.check_standard


@pytest.mark.long
def test_unobservable_parameters_are_not_compared_at_the_end_of_a_run(
    site: SiteFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(site, off=0.01)
    monkeypatch.setattr(finalize, "unobservable", lambda *_: ["gyro_scale_x"])
    request = replace(site.request(), serial=GOLDEN)
    site.request = lambda *stages, **more: request  # type: ignore[method-assign,assignment]
    result = load_result(Path(site.run().result_file))
    assert result.check_standard is not None
    assert result.check_standard.passed
    assert "gyro_scale_x" not in result.check_standard.e_n
    assert "gyro_scale_y" in result.check_standard.e_n


def open_result(log: str) -> Any:
    from calstation.results import stored_result

    return stored_result(open_log(Path(log)))


def site_history(site: SiteFolder) -> History:
    history = History(site.folder / "runs")
    history.refresh()
    return history


def test_overdue_certificate_stops_production_at_the_station(site_folder: SiteFolder) -> None:
    assert allowed(site_folder) is None
    text = site_folder.station.read_text(encoding="utf-8")
    due = date.today() - timedelta(days=1)
    instruments = [
        {"name": "rate table", "kind": "table", "due": due},
        {"name": "thermometer", "kind": "other", "due": due},
        {"name": "gravity survey", "kind": "site", "due": date.today()},
    ]
    site_folder.station.write_text(tomli_w.dumps({"instruments": instruments}) + text, encoding="utf-8")
    error = refused(site_folder, "quality.standard_certificate")
    assert error.values["name"] == "rate table"
    assert error.values["since"] == due.isoformat()
    setup = load_configuration(site_folder.request())
    assert [each.name for each in due_certificates(setup.station, datetime.now(UTC))] == ["rate table"]
    assert [each.name for each in overdue_instruments(setup.station, datetime.now(UTC))] == [
        "rate table",
        "thermometer",
    ]
    states = [instrument_state(each, datetime.now(UTC)) for each in setup.station.instruments]
    assert states == ["overdue", "overdue", "good"]

    instruments[2]["due"] = due
    write(site_folder)
    site_folder.station.write_text(tomli_w.dumps({"instruments": instruments}) + text, encoding="utf-8")
    several = refused(site_folder, "quality.not_in_order")
    day = due.isoformat()
    assert several.render().text == (
        "Production of 'short' on station 'test bench' is refused for several reasons: "
        f"no run of check standard {GOLDEN} has passed, the calibration of 'rate table' was due on {day}, "
        f"the calibration of 'gravity survey' was due on {day}."
    )
    assert several.render("zh_CN").text.endswith(f"“rate table”应于 {day} 前送检、“gravity survey”应于 {day} 前送检。")


@pytest.mark.parametrize(("hour", "overdue"), [(15, []), (17, ["rate table"])])
def test_instrument_is_valid_until_the_end_of_its_due_date_in_utc(
    site_folder: SiteFolder, hour: int, overdue: list[str]
) -> None:
    """The date is independent of the time zone of the computer, as in a certificate."""
    text = site_folder.station.read_text(encoding="utf-8")
    instruments = [{"name": "rate table", "kind": "table", "due": date(2026, 11, 23)}]
    site_folder.station.write_text(tomli_w.dumps({"instruments": instruments}) + text, encoding="utf-8")
    now = datetime(2026, 11, 23, tzinfo=timezone(timedelta(hours=-8))) + timedelta(hours=hour)  # UTC is 8 h later
    found = due_certificates(load_configuration(site_folder.request()).station, now)
    assert [each.name for each in found] == overdue


def test_instrument_that_is_calibrated_in_the_future_is_not_in_order() -> None:
    now = datetime(2026, 11, 23, 12, tzinfo=UTC)
    for due in (None, date(2027, 11, 25)):
        instrument = InstrumentSection(name="gravity survey", kind="site", calibrated=date(2026, 11, 25), due=due)
        assert instrument_state(instrument, now) == "future"
        assert instrument_state(instrument, now + timedelta(days=3)) == ("undated" if due is None else "good")


def test_unnecessary_override_is_not_recorded(site_folder: SiteFolder) -> None:
    assert allowed(site_folder, override_standard="just in case") is None


@pytest.mark.parametrize(
    ("entries", "code"),
    [
        ({"reference": {"gyro_bias_w": {"value": 0.0, "sigma": 1.0}}}, "entry.unknown_parameter"),
        ({"date": "soon"}, "entry.not_a_date"),
        ({"interval_days": 0}, None),
    ],
)
def test_invalid_entries_of_a_check_standard_are_refused(
    site_folder: SiteFolder, entries: dict[str, Any], code: str | None
) -> None:
    section = {"serial": "G", "interval_days": 7, "reference": {"gyro_bias_x": {"value": 0.0, "sigma": 1.0}}, **entries}
    site_folder.write({"check_standards": [section]})
    with pytest.raises(ConfigurationError) as caught:
        load_configuration(site_folder.request())
    if code is not None:
        assert code in json.dumps(caught.value.values, default=repr)


def test_duplicate_check_standard_is_refused(site_folder: SiteFolder) -> None:
    section = {"serial": "G", "interval_days": 7, "reference": {"gyro_bias_x": {"value": 0.0, "sigma": 1.0}}}
    site_folder.write({"check_standards": [section, section]})
    with pytest.raises(ConfigurationError) as caught:
        load_configuration(site_folder.request())
    assert "product.standard_twice" in json.dumps(caught.value.values, default=repr)


def test_check_of_a_station_file_lists_overdue_certificates(
    site_folder: SiteFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    text = site_folder.station.read_text(encoding="utf-8")
    instruments = [{"name": "rate table", "kind": "table", "due": date(2020, 1, 2)}]
    site_folder.station.write_text(tomli_w.dumps({"instruments": instruments}) + text, encoding="utf-8")
    assert run_app(["check", str(site_folder.station), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["overdue"] == [{"name": "rate table", "since": "2020-01-02"}]


@pytest.mark.long
def test_runs_of_the_fast_product_agree_with_the_truth(
    site_folder: SiteFolder, stable: ImuProfile, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sum of T² of independent units is χ² with the sum of their degrees of freedom."""
    monkeypatch.setenv("CALSTATION_HOME", str(site_folder.folder / "home"))
    total, degrees = 0.0, 0
    for number in (104, 105, 106):
        serial = f"SN-{number:06d}"
        request = replace(site_folder.request(), serial=serial, product=library.find("products", "mems_c_fast"))
        site_folder.request = lambda *stages, made=request: made  # type: ignore[method-assign,misc]
        result = load_result(Path(site_folder.run().result_file))
        del site_folder.request  # type: ignore[method-assign]
        truth = BenchConfig.model_validate(bench_config(load_configuration(request))).truth()
        verdict = judge_result(standard(truth.parameters), stable, result)
        assert verdict.passed
        total, degrees = total + verdict.t_squared, degrees + verdict.degrees
        assert set(result.table) == {"orthogonality", "tilt_x", "tilt_y"}
        table = result.table["orthogonality"]
        assert abs(table.value - truth.table.non_orthogonality) < 4.0 * table.sigma
    assert 0.001 < stats.chi2(degrees).cdf(total) < 0.999
