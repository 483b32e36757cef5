"""Preloaded by the server of engine processes (`lent`): what every engine and job worker imports."""

import lent

import calstation.jobs.queue
import calstation.runs.engine
import calstation.runs.run  # noqa: F401

lent.lend_benches()
