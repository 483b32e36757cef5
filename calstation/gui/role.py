"""Operator or engineer: who uses the window now."""

from PySide6.QtCore import QObject, Signal


class RoleLock(QObject):
    """The role in force; `changed` tells every page what it may enable.

    A window starts with the operator.
    """

    changed = Signal(str)

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

    def unlock(self, pin: str) -> bool:
        """Take the engineer's role where `pin` is right."""
        from calstation.station import role

        if not role.check(pin):
            return False
        self._set("engineer")
        return True

    def lock(self) -> None:
        """Back to the operator's role."""
        self._set("operator")

    def _set(self, role: str) -> None:
        if role != self._role:
            self._role = role
            self.changed.emit(role)
