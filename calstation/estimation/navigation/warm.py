"""Compile (or load from numba's cache) every kernel before its first use: solve a few seconds of rest."""

import numpy as np

from calstation.estimation.common.context import Belief, ImuModel, Site, SolveContext, TableModel
from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.navigation.stage import NavigationStage
from calstation.physics.parameters import NAMES, PARAMETERS


def warm_up() -> None:
    """Run the navigation solver once on a made-up rest; takes seconds the first time, then a fraction of one."""
    count, rate = 1000, 100.0
    imu = ImuModel("warm-up", rate, "rate", 1e-6, 1e-6, 1e-5, 1e-4)
    context = SolveContext(Site(0.6, 1.9, 0.0, azimuth=0.0), imu, TableModel())
    counts = np.zeros((count, 6))
    counts[:, 5] = 9.8e6
    seq = np.arange(count)
    block = SampleBlock(
        stage="excitation",
        seq=seq,
        time=(seq + 1) / rate,
        counts=counts,
        angles=np.zeros((count, 2)),
        step=np.zeros(count, np.int64),
        valid=np.ones(count, np.bool_),
        temperature=np.full(count, np.nan),
    )
    prior = Belief(np.zeros(len(NAMES)), np.diag([p.prior_sigma**2 for p in PARAMETERS]))
    stage = NavigationStage("excitation", context, prior, NAMES)
    stage.feed(block)
    stage.sigma()
    stage.finish()
