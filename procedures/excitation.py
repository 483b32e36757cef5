"""Excitation: rotations about y, x, z, then z, x, y, repeated; the 39-state filter finds all parameters.

Each body axis is turned through four quarter turns with a rest after each, always the same way round; a joint
unwinds by whole turns only where its travel demands it.
"""

from calstation.estimation.context import Belief, SolveContext
from calstation.estimation.navigation_stage import NavigationStage
from calstation.physics.parameters import NAMES


def estimates(context: SolveContext) -> tuple[str, ...]:
    """All 30 parameters; the outer lever only where the table has one."""
    return tuple(n for n in NAMES if context.table.outer_lever == "estimated" or not n.startswith("outer"))


def solver(context: SolveContext, prior: Belief) -> NavigationStage:
    """The 39-state filter over the stage."""
    return NavigationStage("excitation", context, prior, estimates(context))
