"""The schedule of a stage in words, for a certificate."""

from collections.abc import Iterator, Mapping

from pydantic import JsonValue

from calstation.config import schedule_fields
from calstation.messages import Language, Text, parameter_name, plain_number, render, schedule_name
from calstation.physics import unit_of_parameter

#: Kinds of entries that are shown; lists of moves are only in the product file.
_SHOWN = ("number", "count", "flag", "choice", "targets")


def schedule_words(
    stage: str, values: Mapping[str, JsonValue], language: Language, rounds: int | None = None
) -> Iterator[str]:
    """Yield the entries of the schedule of a stage in display units.

    Parameters
    ----------
    stage : name of the stage
    values : schedule in the log
    language : language of the names
    rounds : number of completed rounds, which is shown before the planned number if it is smaller; None if unknown
    """
    for spec in schedule_fields(stage):
        if spec.kind not in _SHOWN:
            continue
        name = schedule_name(spec.name, language, stage=stage)
        match values.get(spec.name):
            case True:
                yield name
            case dict() as targets if targets:
                yield f"{name}: {', '.join(_target(each, sigma, language) for each, sigma in targets.items())}"
            case str() as chosen:
                yield f"{name} {chosen.replace('_', ' ')}"
            case int() as planned if spec.name == "rounds" and rounds is not None and not 0 < planned <= rounds:
                text = Text.of("certificate.rounds_made", name=name, count=rounds, planned=planned)
                yield render(text.code, text.values, language).text if planned else f"{name} {rounds}"
            case int() | float() as number if number is not False:
                yield f"{name} {number:g} {spec.unit}".rstrip()


def _target(subject: str, sigma: JsonValue, language: Language) -> str:
    """Return the target sigma, SI, of a parameter or group as text in the display unit."""
    name = parameter_name(subject, language)
    if not isinstance(sigma, int | float):
        return name
    unit, size = unit_of_parameter(subject)
    return f"{name} {plain_number(sigma / size, '.3g')} {unit}".rstrip()
