"""The next run with the current station, product and stages, or why they cannot be used."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from calstation.config import ManualRigError, RunRequest, compatible_products
from calstation.errors import CalstationError
from calstation.gui.operator.questions import refusal, wrong_rig
from calstation.gui.state import AppContext
from calstation.gui.widgets import Choice
from calstation.messages import Text
from calstation.runs import RunSummary, run_summary


def read_next_run(
    app: AppContext, products: Sequence[tuple[str, Path]]
) -> tuple[RunSummary | None, Text | None, list[Choice]]:
    """Return the summary of the next run or, if there is none, the problem and the choices that solve it.

    `products` are the names and files that are offered.
    """
    open_station = Choice("station_choice", "answer.station", partial(app.page_requested.emit, "station_page"))
    if app.run.elsewhere is not None:
        return None, Text("question.other_window"), [open_station]
    request = RunRequest("-", app.station_path, app.product_path, app.stages, schedule=app.schedule)
    try:
        return run_summary(request), None, []
    except ManualRigError as error:
        compatible = compatible_products(app.station_path, app.product_path)
        display_names = {path: name for name, path in products}
        names = ", ".join(f"“{display_names[path]}”" for _, path in compatible)
        about = Text.of("window.compatible_products" if compatible else "window.no_compatible_product", names=names)
        choices = []
        for name, path in compatible[:2]:  # the notice lists all of them
            words = Text.of("window.choose_product", name=display_names[path])
            choices.append(Choice(f"product_choice_{name}", words, partial(app.set_product, path)))
        code = "pair_station" if error.code == "product.pair_station" else "wrong_table"
        question = Text.of(f"question.{code}", why=Text(wrong_rig(error)), products=about)
        return None, question, [*choices, open_station]
    except CalstationError as error:
        if stages := _wrong_schedules(request):
            open_engineer = partial(app.page_requested.emit, "engineer_page")
            answers = {"whole": partial(app.choose, None, None), "engineer": open_engineer}
            choices = [Choice(f"{name}_choice", f"answer.{name}", act) for name, act in answers.items()]
            return None, Text.of("question.wrong_schedule", why=error.as_text, stages=stages), choices
        return None, refusal("cannot_run", error, engineer=app.role.engineer), [open_station]


def selection_question(app: AppContext, summary: RunSummary) -> Text:
    """Return which stages or schedules of the next run differ from the product's: a term of the family ``question``."""
    if summary.omitted:
        return Text.of("question.selected_stages", stages=app.stages)
    return Text.of("question.selected_schedule", stages=tuple(app.schedule or app.stages or ()))


def _wrong_schedules(request: RunRequest) -> tuple[str, ...]:
    """Return the stages whose changed schedules prevent a run; () if the run is also impossible without changes."""
    changes = request.schedule or {}
    if not (changes and _possible(request, {})):
        return ()
    return tuple(stage for stage in changes if not _possible(request, {stage: changes[stage]})) or tuple(changes)


def _possible(request: RunRequest, schedule: Mapping[str, Mapping[str, Any]]) -> bool:
    try:
        run_summary(replace(request, schedule=schedule))
    except CalstationError:
        return False
    return True
