"""Operator or engineer: who uses the window now."""

from PySide6.QtCore import QObject, Signal

from calstation.config import access as pins


class RoleLock(QObject):
    """The role in force; `changed` tells every page what it may enable.

    A window starts with the operator. `wanted` asks the main window to let the user enter the PIN.
    """

    changed = Signal(str)
    wanted = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._role = "operator"

    @property
    def role(self) -> str:
        """``operator`` or ``engineer``."""
        return self._role

    @property
    def engineer(self) -> bool:
        """Whether what changes results may be touched."""
        return self._role == "engineer"

    @property
    def new(self) -> bool:
        """Whether no PIN has been set yet: the first to come sets it."""
        return not pins.has_pin()

    @property
    def wait(self) -> float:
        """Seconds until a PIN may be tried again."""
        return pins.wait()

    def ask(self) -> None:
        """Let the user enter the PIN."""
        self.wanted.emit()

    def unlock(self, pin: str) -> bool:
        """Take the engineer's role where `pin` is right. Raises ConfigurationError where it cannot be checked."""
        if not pins.check(pin):
            return False
        self._set("engineer")
        return True

    def set_first_pin(self, pin: str) -> None:
        """Set the PIN of a new place and take the engineer's role. Raises ConfigurationError with the reason."""
        pins.set_pin("", pin)
        self._set("engineer")

    def lock(self) -> None:
        """Back to the operator's role."""
        self._set("operator")

    def _set(self, role: str) -> None:
        if role != self._role:
            self._role = role
            self.changed.emit(role)
