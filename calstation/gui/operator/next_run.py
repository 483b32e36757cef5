"""The next run with the current station, product and stages, or why they cannot be used."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from calstation.config import ManualRigError, RunRequest, compatible_products
from calstation.errors import CalstationError
from calstation.gui.operator.questions import has_pair, refusal, wrong_rig
from calstation.gui.state import AppContext
from calstation.gui.widgets import Choice
from calstation.messages import Text
from calstation.runs import RunSummary, run_summary


def read_next_run(
    app: AppContext, products: Sequence[tuple[str, Path]]
) -> tuple[RunSummary | None, Text | None, list[Choice]]:
    """Return the summary of the next run, or None, the problem and choices of compatible products.

    `products` are the names and files that are offered.
    """
    if app.run.elsewhere is not None:
        return None, Text("question.other_window"), []
    try:
        request = RunRequest("-", app.station_path, app.product_path, app.stages, schedule=app.schedule)
        return run_summary(request), None, []
    except ManualRigError as error:
        compatible = compatible_products(app.station_path, app.product_path)
        display_names = {path: name for name, path in products}
        names = ", ".join(f"“{display_names[path]}”" for _, path in compatible)
        why = Text("window.pair_station") if has_pair(app.station_path) else Text(wrong_rig(error))
        about = Text.of("window.compatible_products" if compatible else "window.no_compatible_product", names=names)
        choices = []
        for name, path in compatible[:2]:  # the notice lists all of them
            words = Text.of("window.choose_product", name=display_names[path])
            choices.append(Choice(f"product_choice_{name}", words, partial(app.set_product, path)))
        return None, Text.of("question.wrong_table", why=why, products=about), choices
    except CalstationError as error:
        return None, refusal("cannot_run", error, engineer=app.role.engineer), []
