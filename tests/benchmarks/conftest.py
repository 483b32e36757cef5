"""Benchmarks run only on request: pytest tests/benchmarks --benchmark-enable."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from tests.site_folder import SiteFolder

sys.path.append(str(Path(__file__).parent.parent / "estimation"))


def pytest_runtest_setup(item):
    """Skip pure timing tests unless benchmarks are enabled."""
    if "benchmark" in item.fixturenames and not item.config.getoption("benchmark_enable"):
        pytest.skip("a benchmark: pytest tests/benchmarks --benchmark-enable")


@pytest.fixture
def figures(benchmark, record_property):
    """Record the results of a benchmark and print them at the end."""

    def take(**found):
        benchmark.extra_info.update(found)
        for name, value in found.items():
            record_property(name, value)

    return take


def pytest_terminal_summary(terminalreporter):
    """Print the results of the benchmarks, one line each."""
    for report in terminalreporter.stats.get("passed", []):
        if report.when == "call" and "benchmarks" in report.nodeid and report.user_properties:
            found = ", ".join(f"{name} {value}" for name, value in report.user_properties)
            terminalreporter.write_line(f"{report.nodeid.partition('::')[2]}: {found}")


@pytest.fixture
def window_site(tmp_path, monkeypatch):
    """Create a site for a window, which is the current folder."""
    made = SiteFolder(tmp_path, tmp_path / "home")
    monkeypatch.setenv("CALSTATION_HOME", str(made.home))
    monkeypatch.chdir(tmp_path)
    return made


@pytest.fixture(scope="session")
def stage():
    """Excitation samples of a navigation-grade unit at 200 Hz, with the inputs of the filter."""
    from simulated_stages import block_of, context_of, prior_of, simulate

    from calstation.estimation.common import stage_data, starts

    truth = BenchConfig(grade="nav", seed=41).truth()
    block = block_of(simulate(Simulator(truth, 41), truth, "excitation"))
    context, prior = context_of(truth), prior_of(truth)
    data = stage_data([block], context.imu)
    (start,) = starts(data, context, prior)
    return SimpleNamespace(truth=truth, block=block, context=context, prior=prior, data=data, start=start)
