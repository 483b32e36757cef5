"""The notice that states whether the chamber may be opened, and the reason why it must stay closed."""

from calstation.gui.state.run_status import RunStatus
from calstation.gui.text import say
from calstation.gui.widgets import Choice, NoticeBar

#: Badge shape of the notice.
_KINDS = {"closed": "caution", "unknown": "bad", "open": "good"}


class ChamberNotice(NoticeBar):
    """States, from the end of a run over temperature, whether the chamber may be opened."""

    def __init__(self, run: RunStatus, prefix: str) -> None:
        super().__init__(f"{prefix}chamber_notice")
        self._run, self._access = run, ""
        run.changed.connect(self.show_state)

    def show_state(self) -> None:
        """Show whether the chamber may be opened; hide the notice during a run and without a chamber."""
        access = self._run.chamber.access
        if access == self._access:
            self.refresh()
            return
        self._access = access
        if not access:
            self.dismiss()
            return
        words = "operator.chamber_looked_at" if access == "unknown" else "operator.chamber_hide"
        close = Choice(f"{self.objectName()}_close", words, self._run.acknowledge_chamber)
        title, choices = f"operator.chamber_{access}", () if access == "closed" else (close,)
        self.ask(_KINDS[access], title, lambda: chamber_reason(self._run), choices)


def chamber_reason(run: RunStatus) -> str:
    """Return why the chamber must stay closed; "" if it may be opened."""
    chamber = run.chamber
    if not chamber.must_stay_closed:
        return ""
    if chamber.unchecked:
        return say("operator.chamber_unchecked")
    if chamber.access == "unknown":
        return say("operator.chamber_unknown_remedy")
    latest = chamber.latest
    if latest is None:
        return say("operator.chamber_returns")
    low, high = latest.open_c
    farthest = chamber.farthest
    if latest.door_open:
        return say("operator.chamber_door_open")
    if farthest is None:
        code = "operator.chamber_within" if latest.units else "operator.chamber_blind"
        return say(code, target=latest.target_c, air=latest.air_c)
    slot, value, distance = farthest
    values = {"what": thing_text(slot), "value": value, "difference": abs(distance)}
    if distance < 0.0:
        return say("operator.chamber_cold", dew_point=low, **values)
    return say("operator.chamber_hot", limit=high, **values)


def thing_text(slot: str | None) -> str:
    """Return the subject of a temperature for the start of a line: the air (None), the unit (""), or that in a slot."""
    if slot is None:
        return say("operator.chamber_air")
    return say("operator.chamber_slot", slot=slot) if slot else say("operator.chamber_unit")
