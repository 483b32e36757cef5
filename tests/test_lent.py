"""Forked processes have imported all modules at their start."""

import multiprocessing
import sys
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext

import pytest


def report_modules(there: "Connection[list[str], None]") -> None:
    there.send(list(sys.modules))


def test_forked_engine_process_has_imported_the_run_modules() -> None:
    context = multiprocessing.get_context("spawn")
    if not isinstance(context, ForkServerContext):
        pytest.skip("processes are not lent here")
    here, there = context.Pipe()
    process = context.Process(target=report_modules, args=(there,))
    process.start()
    there.close()
    assert "calstation.runs.run" in here.recv(), "an import has failed: run `python tests/lent_engine.py`"
    process.join()
    here.close()
