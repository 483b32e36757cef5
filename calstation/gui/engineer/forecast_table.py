"""Expected sigmas, stage by stage, against what the product allows."""

from functools import partial

from PySide6.QtCore import QCoreApplication

from calstation.gui.text.messages import show, term
from calstation.gui.widgets.parameter_table import Column
from calstation.messages.marked import QT_TRANSLATE_NOOP
from calstation.physics.parameters import INDEX, NAMES
from calstation.physics.units import display
from calstation.results.preview import Preview


def _say(text: str) -> str:
    return QCoreApplication.translate("forecast", text)


def names(forecast: Preview) -> tuple[str, ...]:
    """Parameters that some stage estimates, in the table's order."""
    estimated = {name for stage in forecast.stages for name in stage.estimated}
    return tuple(name for name in NAMES if name in estimated)


def columns(forecast: Preview) -> list[Column]:
    """Unit, before, after each stage, limit, target, verdict."""
    made = [
        Column(
            lambda: _say(QT_TRANSLATE_NOOP("forecast", "Unit")),
            lambda name: display(name, 0.0)[1],
            number=False,
        ),
        Column(
            lambda: _say(QT_TRANSLATE_NOOP("forecast", "σ before")),
            lambda name: shown(name, float(forecast.before[INDEX[name]])),
        ),
    ]
    for number, stage in enumerate(forecast.stages):
        made.append(
            Column(
                partial(term, "stage", stage.stage),
                partial(_sigma_after, forecast, number),
                hint=partial(_hint, forecast, number),
            )
        )
    made.append(
        Column(
            lambda: _say(QT_TRANSLATE_NOOP("forecast", "σ limit")),
            lambda name: _bound(name, forecast.limits.get(name)),
        )
    )
    if forecast.targets:
        made.append(
            Column(
                lambda: _say(QT_TRANSLATE_NOOP("forecast", "σ target")),
                lambda name: _bound(name, forecast.targets.get(name)),
            )
        )
    made.append(
        Column(
            lambda: _say(QT_TRANSLATE_NOOP("forecast", "Expected")),
            partial(_verdict, forecast),
            number=False,
            state=partial(_state, forecast),
        )
    )
    return made


def shown(name: str, sigma: float) -> str:
    """A sigma in the unit people read, three digits."""
    value = abs(display(name, sigma)[0])
    if value >= 1000.0:
        return f"{value:.0f}"
    return f"{value:#.3g}".rstrip(".") if value >= 1e-4 else f"{value:.2g}"


def _sigma_after(forecast: Preview, number: int, name: str) -> str:
    sigma = forecast.stages[number].sigma
    return "—" if sigma is None else shown(name, float(sigma[INDEX[name]]))


def _hint(forecast: Preview, number: int, name: str) -> str:
    stage = forecast.stages[number]
    if stage.sigma is None:
        return "" if stage.error is None else show(stage.error)
    before = forecast.before if number == 0 else forecast.stages[number - 1].sigma
    if name not in stage.estimated or before is None:
        return _say(QT_TRANSLATE_NOOP("forecast", "This stage leaves it as it was."))
    gain = float(before[INDEX[name]] / stage.sigma[INDEX[name]]) if stage.sigma[INDEX[name]] > 0 else 1.0
    return _say(QT_TRANSLATE_NOOP("forecast", "{0:.3g} times better known than before this stage")).format(
        gain
    )


def _bound(name: str, bound: float | None) -> str:
    return "" if bound is None else shown(name, bound)


def _last(forecast: Preview, name: str) -> float | None:
    sigma = forecast.stages[-1].sigma if forecast.stages else None
    return None if sigma is None else float(sigma[INDEX[name]])


def reached(forecast: Preview, name: str) -> bool | None:
    """Whether a parameter's limit will be met, None where nothing says so."""
    sigma, limit = _last(forecast, name), forecast.limits.get(name)
    return None if sigma is None or limit is None else sigma <= limit


def _verdict(forecast: Preview, name: str) -> str:
    met = reached(forecast, name)
    if met is None:
        return _say(QT_TRANSLATE_NOOP("forecast", "no limit")) if name not in forecast.limits else "—"
    return (
        _say(QT_TRANSLATE_NOOP("forecast", "reached"))
        if met
        else _say(QT_TRANSLATE_NOOP("forecast", "missed"))
    )


def _state(forecast: Preview, name: str) -> str | None:
    met = reached(forecast, name)
    return None if met is None else "good" if met else "bad"
