"""The role of the user: operator or engineer."""

from PySide6.QtCore import QObject, Signal

from calstation.config import access


class RoleLock(QObject):
    """The current role, at first the operator.

    `changed(role)` : the role has changed; `wanted()` : the user wants to enter the engineer's PIN.
    """

    changed = Signal(str)
    wanted = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.role = "operator"

    @property
    def engineer(self) -> bool:
        """Whether settings that change results may be edited."""
        return self.role == "engineer"

    @property
    def new(self) -> bool:
        """Whether no PIN has been set yet: the first user sets it."""
        return not access.has_pin()

    @property
    def wait(self) -> float:
        """Seconds until a PIN may be tried again."""
        return access.wait()

    def ask(self) -> None:
        """Let the user enter the PIN."""
        self.wanted.emit()

    def unlock(self, pin: str) -> bool:
        """Switch to the engineer if `pin` is right. Raises ConfigurationError if it cannot be checked."""
        if not access.check(pin):
            return False
        self._set("engineer")
        return True

    def set_first_pin(self, pin: str) -> None:
        """Set the first PIN and switch to the engineer. Raises ConfigurationError if the PIN cannot be used."""
        access.set_pin("", pin)
        self._set("engineer")

    def lock(self) -> None:
        """Switch to the operator."""
        self._set("operator")

    def _set(self, role: str) -> None:
        if role != self.role:
            self.role = role
            self.changed.emit(role)
