"""Modules of every engine and job worker, preloaded by the server of engine processes (`lent`)."""

import importlib

import lent

for name in ("connection", "devices", "jobs", "records", "registers", "results", "runs", "sequencer", "simulation"):
    package = importlib.import_module(f"calstation.{name}")
    for public in package.__all__:
        getattr(package, public)

importlib.import_module("calstation.runs.run")
importlib.import_module("calstation.estimation.navigation.stage").warm_up()
lent.lend_benches()
