"""What is to be done with a unit after a run, as a word that the listener puts into its language."""

from calstation.config.station import ProductConfig
from calstation.errors import ConfigurationError


def advice(product: ProductConfig, outcome: str, failures: int, finished: bool) -> str | None:
    """``reseat``, ``repeat``, ``set_aside`` or ``resume``; None for a unit that passed.

    Parameters
    ----------
    failures : times in a row, this one included, that the unit was outside its limits
    finished : whether a stage was finished, so that the run can be resumed
    """
    if outcome == "passed":
        return None
    if outcome != "failed":
        return "resume" if finished else "repeat"
    if product.attempts_allowed is not None and failures >= product.attempts_allowed:
        return "set_aside"
    return product.advice[min(failures, len(product.advice)) - 1]


def check_attempts(product: ProductConfig, serial: str, failures: int, beyond: bool) -> None:
    """May the unit be calibrated again? `beyond` : an engineer says so. Raises ConfigurationError."""
    allowed = product.attempts_allowed
    if allowed is not None and failures >= allowed and not beyond:
        times = "once" if failures == 1 else f"{failures} times in a row"
        raise ConfigurationError(
            f"{serial}: was outside its limits {times}, and attempts_allowed = {allowed} of '{product.name}' are"
            " used up; set the unit aside, or let an engineer allow another (--beyond-attempts)"
        )
