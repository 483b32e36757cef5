"""Runs on the virtual bench that are made once per test session, by the first worker that needs them."""

import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from calstation.records import locked
from calstation.sequencer import Finalized
from tests.site_folder import SiteFolder


class SharedRuns:
    """Runs in separate folders below `root`."""

    def __init__(self, root: Path) -> None:
        self._root = root
        root.mkdir(exist_ok=True)

    def copy(self, name: str, folder: Path, make: Callable[[SiteFolder], Finalized]) -> Finalized:
        """Copy a run to `folder`; its result still refers to the original log."""
        ended = self._made(name, make)
        shutil.copytree(self._root / name, folder, ignore=shutil.ignore_patterns("reports.jsonl"), dirs_exist_ok=True)
        log, result_file = (
            str(folder / Path(f).relative_to(self._root / name)) for f in (ended.log, ended.result_file)
        )
        return replace(ended, log=log, result_file=result_file)

    def passed(self, folder: Path, *stages: str) -> Finalized:
        """Copy a passed run of these stages to `folder`."""
        ended = self.copy("-".join(stages) or "full", folder, lambda site: site.run(*stages))
        assert ended.verdict.passed
        return ended

    def _made(self, name: str, make: Callable[[SiteFolder], Finalized]) -> Finalized:
        done = self._root / f"{name}.pickle"
        with locked(self._root / f"{name}.lock", timeout=240.0):
            if not done.exists():
                (self._root / name).mkdir()
                ended = make(SiteFolder(self._root / name))
                done.write_bytes(pickle.dumps(ended))
        ended = pickle.loads(done.read_bytes())
        assert isinstance(ended, Finalized)
        return ended
