"""A product that is carried by hand on a table that is driven, or the other way round: what to choose in its place."""

from functools import partial

from PySide6.QtCore import QCoreApplication

from calstation.config.resolved import ManualRigError
from calstation.config.summary import compatible_products
from calstation.gui.shell.context import AppContext
from calstation.gui.widgets.notice import Choice

#: Most products that get a button; all are named.
_BUTTONS = 2


class CompatibilityNotice:
    """Words and answers for the operator, who chooses products and knows no stages."""

    def __init__(self, app: AppContext, error: ManualRigError) -> None:
        self._app, self._error = app, error
        self._found = compatible_products(app.station_path, app.product_path)

    def words(self) -> str:
        """What does not fit, and what does."""
        if self._error.by_hand:
            why = QCoreApplication.translate(
                "misfit", "At this station the rails are turned by hand; what is chosen needs a driven table."
            )
        else:
            why = QCoreApplication.translate(
                "misfit", "The table of this station is driven; what is chosen is turned by hand."
            )
        return f"{why} {self._mend()}"

    def choices(self) -> list[Choice]:
        """Buttons that select what fits."""
        return [
            Choice(f"product_choice_{name}", partial(_use, name), partial(self._app.set_product, path))
            for name, path in self._found[:_BUTTONS]
        ]

    def _mend(self) -> str:
        if not self._found:
            return QCoreApplication.translate("misfit", "No product fits here: choose another station.")
        names = ", ".join(name for name, _ in self._found)
        return QCoreApplication.translate("misfit", "Products that fit here: {names}.").format(names=names)


def _use(name: str) -> str:
    return QCoreApplication.translate("misfit", "Choose {name}").format(name=name)
