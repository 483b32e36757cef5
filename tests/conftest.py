"""Fixtures of all tests; benches and engines are forked from warm servers (`lent`)."""

from __future__ import annotations

import gc
import os
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from zlib import crc32

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in a run; several workers would wait for one another

import lent
import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from tests.shared_runs import SharedRuns
    from tests.site_folder import SiteFolder


for profile, examples in (("suite", 25), ("exhaustive", 300)):
    settings.register_profile(
        profile, max_examples=examples, deadline=None, suppress_health_check=[HealthCheck.too_slow]
    )

#: Tests of answers that must come within a fraction of a second of real time. A computer that serves others may stand
#: still for longer, so these, and no others, are run again up to twice if they fail; the report marks them with R.
REAL_TIME = (
    "bench/test_bench_late_answers.py",
    "bench/test_bench_text_tables.py",
    "bench/test_bench_units.py",
    "connection/test_identification.py",
    "connection/test_link_tests.py",
    "connection/test_text_line_check.py",
    "devices/test_framed_imu.py",
    "devices/test_late_answers.py",
    "devices/test_restart_evidence.py",
    "devices/test_shared_table.py",
    "devices/test_text_table.py",
    "devices/test_wake.py",
    "runs/test_channel.py",
    "runs/test_pipe_reader.py",
)


#: Folders of tests of whole calibrations.
REHEARSED = {"fleet", "outside", "verify"}


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Allow reruns of real-time tests; PostgreSQL, the window in Chinese and whole calibrations are for rehearsals.

    Of the long cases of one test, the rehearsals run two, or one if the cases differ only in their language.
    """
    long = defaultdict(list)
    for item in items:
        folders = item.path.parent.relative_to(Path(__file__).parent).parts
        chinese = "zh_CN" in item.name and "gui" in folders
        if chinese or "postgres" in getattr(item, "fixturenames", ()) or REHEARSED.intersection(folders):
            item.add_marker(pytest.mark.long)
        if item.path.as_posix().endswith(REAL_TIME):
            item.add_marker(pytest.mark.flaky(reruns=2))
        if item.get_closest_marker("long") and not item.get_closest_marker("exhaustive"):
            long[item.nodeid.partition("[")[0]].append(item)
    for cases in long.values():
        languages = len(cases) == 2 and any("zh_CN" in item.name for item in cases)
        for item in sorted(cases, key=lambda item: crc32(item.nodeid.encode()))[1 if languages else 2 :]:
            item.add_marker(pytest.mark.exhaustive)


def pytest_collection_finish() -> None:
    """Exclude the modules and tests, which remain until the end, from garbage collection."""
    gc.freeze()


def pytest_runtest_teardown() -> None:
    """Collect garbage in a process in which a window has left that to its own thread."""
    if not gc.isenabled():
        from calstation.gui.shell.garbage import collect_garbage

        collect_garbage()


def pytest_configure(config: pytest.Config) -> None:
    """Install the servers in processes that run tests, not in one that distributes tests to workers or lists them."""
    distributes = config.getoption("numprocesses", default=None) or config.getoption("collectonly")
    if "PYTEST_XDIST_WORKER" in os.environ or not distributes:
        lent.install()


@pytest.fixture(scope="session", autouse=True)
def _home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A temporary site folder for tests without their own, separate from the user's; PIN hashing is fast."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CALSTATION_HOME", str(tmp_path_factory.mktemp("home")))
        patch.setattr("calstation.config.access._N", 2**10)
        yield


@pytest.fixture
def site_folder(tmp_path: Path) -> SiteFolder:
    """A folder with a product and a station file."""
    from tests.site_folder import SiteFolder

    return SiteFolder(tmp_path)


@pytest.fixture
def corrected_site(site_folder: SiteFolder, monkeypatch: pytest.MonkeyPatch) -> SiteFolder:
    """A site folder with a unit whose registers are applied to its samples."""
    from calstation.config import library
    from tests.site_folder import with_corrected_output

    home = site_folder.folder / "home"
    (home / "imus").mkdir(parents=True)
    shipped = library.find("imus", "bench_nav").read_text(encoding="utf-8")
    (home / "imus" / "bench_nav.toml").write_text(with_corrected_output(shipped), encoding="utf-8")
    monkeypatch.setenv("CALSTATION_HOME", str(home))
    return site_folder


@pytest.fixture(scope="session")
def shared_runs(tmp_path_factory: pytest.TempPathFactory) -> SharedRuns:
    """Runs made once for all tests that only read their files."""
    from tests.shared_runs import SharedRuns

    root = tmp_path_factory.getbasetemp()
    return SharedRuns((root.parent if "PYTEST_XDIST_WORKER" in os.environ else root) / "shared")
