"""A pass of a solution: the filter along a smoothed reference, compiled."""

import numpy as np

from calstation.estimation.common import Posterior, SolveContext, StageData, Start
from calstation.estimation.navigation.group_update import Updates, process, updates
from calstation.estimation.navigation.navigation_pass import NavigationPass
from calstation.estimation.navigation.reference import Reference, smoothed_reference
from calstation.physics import STATES, FloatArray


class ReferencePass(NavigationPass):
    """A pass that follows a smoothed trajectory and does not close the loop.

    The transitions along a trajectory that jumps at every observation have unobservable directions that differ by the
    size of the jumps, so a bias and a tilt of which only the sum is observable would appear to be observable separately
    (Huang, Mourikis, Roumeliotis, *Observability-based rules for designing consistent EKF SLAM estimators*, IJRR 29(5),
    2010).
    """

    #: How the last call of `observe` processed its groups.
    last: Updates
    _reference: Reference
    _begin: int  # index of its first sample

    def __init__(self, context: SolveContext, prior: Posterior, point: FloatArray) -> None:
        super().__init__(context, prior, point)
        #: All updates, in order.
        self.updates: list[Updates] = []

    def begin(self, data: StageData, start: Start, attitude: FloatArray) -> None:
        """Compute the reference of the segment, and start at rest: reset the navigation states, keep the parameters."""
        self._begin = start.begin
        self._reference = smoothed_reference(
            self.constants, self.earth, self.gravity, self.noise, self._motion(data), self.dt,
            (start.begin, start.end, self.stride), attitude, float(start.prior_sigma[0]),
        )  # fmt: skip
        self._reset(start, self._reference.attitude[0])
        H, root, gain = self._observe_start(data, start.begin)
        none = np.empty((1, 0, 0))
        self.updates.append(Updates(none, np.empty(0), H[None], root[None], gain[None], none[0], none, none[0]))

    def observe(self, data: StageData, first: int, count: int, groups: int = 1) -> None:
        """Process groups of `count` observations from sample `first`: strapdown, prediction and update."""
        self.group = group = self._group(count)
        self.last = updates(groups, count, np.diag(group.transition)[STATES:].copy())
        done = (first - self._begin) // self.stride + 1
        ends = slice(done, done + groups * count)
        process(
            self.constants, self.setting, self._motion(data), first, self._reference.attitude[ends],
            self._reference.velocity[ends], self.arm_velocity, self.work, group, self.state, self.last,
        )  # fmt: skip
        self.updates.append(self.last)
        index = first + self.stride * np.arange(1, groups * count + 1)
        self._history.append((index, self.last.attitude, self.last.rate, self.last.innovation.reshape(-1, 3)))
