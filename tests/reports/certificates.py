"""Runs of every type with their certificates, created once per test session."""

import pickle
import tomllib
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

import tomli_w

from calstation.records import open_log
from calstation.reports import Certificate, build_certificate
from calstation.reports.analysis import Analysis, analyse
from calstation.results import load_result
from calstation.sequencer import Finalized
from tests.gimbal_site import GimbalSite
from tests.shared_runs import SharedRuns
from tests.site_folder import PRODUCT, SiteFolder

LABORATORY: dict[str, Any] = {
    "laboratory": {
        "name": "Inertial Laboratory",
        "address": "Musterstraße 1, 80331 München",
        "place": "Building 4",
        "customer": "示例航电有限公司",
        "signatories": ["Dr A. Example, head of laboratory", "Li Na 李娜, engineer"],
    },
    "instruments": [
        {
            "name": "Rate table RT-200",
            "serial": "T-0042",
            "kind": "table",
            "certificate": "PTB-0815",
            "calibrated": date(2020, 3, 2),
            "due": date(2121, 3, 2),
        },
        {
            "name": "Thermometer PT-7",
            "kind": "other",
            "due": date(2021, 3, 2),
        },  # refuses no run
    ],
}
#: Kinds of runs.
KINDS = ("passed", "partial", "failed", "gimbal")


@dataclass(frozen=True)
class Made:
    """A run with its certificate."""

    folder: Path
    result_file: Path
    certificate: Certificate
    analysis: Analysis


def make(shared: SharedRuns, folder: Path, kind: str) -> Made:
    """Copy a run of a type to `folder`, with its certificate."""
    ended = shared.copy(f"certificate-{kind}", folder, _RUNS[kind])
    result_file = Path(ended.result_file)
    analysis = pickle.loads((folder / "analysis.pickle").read_bytes())
    log = open_log(result_file.with_suffix(".h5"))
    certificate = build_certificate(load_result(result_file), log.meta, budget=analysis.budget)
    return Made(folder, result_file, replace(certificate, temperature=analysis.temperature), analysis)


def with_laboratory(site: SiteFolder, **entries: Any) -> None:
    """Add a laboratory and its instruments to the station file."""
    station = tomllib.loads(site.station.read_text(encoding="utf-8"))
    site.station.write_text(tomli_w.dumps({**station, **LABORATORY, **entries}), encoding="utf-8")


def analysed(site: SiteFolder, ended: Finalized) -> Finalized:
    """Store the analysis of a run in its folder."""
    result = load_result(Path(ended.result_file))
    found = analyse(lambda *args, **more: None, open_log(Path(ended.log)), result)
    (site.folder / "analysis.pickle").write_bytes(pickle.dumps(found))
    return ended


def _passed(site: SiteFolder) -> Finalized:
    with_laboratory(site)
    return analysed(site, site.run())


def _partial(site: SiteFolder) -> Finalized:
    with_laboratory(site)
    site.run()
    return analysed(site, site.run("azimuth_flip"))


def _failed(site: SiteFolder) -> Finalized:
    limits = {**PRODUCT["limits"], "gyro_scale": {"within": 1e-6}}
    site.write({"stages": ["rate"], "limits": limits})
    with_laboratory(site)
    return analysed(site, site.run())


def _gimbal(site: SiteFolder) -> Finalized:
    gimbal = GimbalSite(site.folder)
    with_laboratory(gimbal)
    return analysed(gimbal, gimbal.run())


_RUNS = {"passed": _passed, "partial": _partial, "failed": _failed, "gimbal": _gimbal}
