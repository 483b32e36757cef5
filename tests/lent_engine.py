"""Modules of every engine and job worker, preloaded by the server of engine processes (`lent`)."""

import importlib

import lent

for name in ("connection", "devices", "jobs", "records", "registers", "results", "runs", "sequencer", "simulation"):
    importlib.import_module(f"calstation.{name}")

importlib.import_module("calstation.runs.run")
importlib.import_module("calstation.estimation.navigation.stage").warm_up()
lent.lend_benches()
