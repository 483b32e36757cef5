"""The notice that another station works on the unit of this one."""

from collections.abc import Sequence
from datetime import UTC, datetime

from calstation.database import Claim, claim_scanned, release_scanned
from calstation.gui.shell import AppContext
from calstation.gui.text import event_sentence
from calstation.gui.widgets import JobWatch, NoticeBar


class ClaimNotice(NoticeBar):
    """Claims a unit in the shared database, and shows claims of other stations on it; they prevent nothing."""

    def __init__(self, app: AppContext) -> None:
        super().__init__("claim_notice")
        self._app = app
        self._serial = ""
        self._claims: Sequence[Claim] = ()
        self._asked = datetime.min.replace(tzinfo=UTC)
        self._watch, self._releasing = JobWatch(self, self._take), JobWatch(self)
        app.exchange_changed.connect(self._follow)
        app.engine_link.running_changed.connect(self._running_changed)

    def claim(self, serial: str) -> None:
        """Claim a unit in place of the previous one, unless the database is away; ends without an answer if so."""
        state = self._app.exchange_state
        if serial == self._serial or state is None or state.error is not None:
            return
        app, previous = self._app, self._serial
        self._serial = serial
        self._show(())
        if previous:
            job = app.job_queue.submit(release_scanned, app.station_path, app.runs_folder, previous)
            self._releasing.watch(job)
        operator = app.operator
        self._watch.watch(app.job_queue.submit(claim_scanned, app.station_path, app.runs_folder, serial, operator))

    def _running_changed(self, running: bool) -> None:
        request = self._app.engine_link.request
        if request is None or self._app.run.register_operation:
            return
        if running:
            self.claim(request.serial)
        elif request.serial == self._serial:  # the claim ends when the run arrives in the database
            self._serial = ""
            self._show(())

    def _take(self, claims: list[Claim]) -> None:
        self._asked = datetime.now(UTC)
        self._show(claims)

    def _follow(self) -> None:
        """Show what the exchange has received since this unit was claimed."""
        state = self._app.exchange_state
        if state is None:
            self._serial = ""
            self._show(())
        elif state.contact_utc is not None and state.contact_utc > self._asked and not self._watch.busy:
            self._show(state.claims)

    def _show(self, claims: Sequence[Claim]) -> None:
        mine = [claim for claim in claims if claim.serial == self._serial]
        if mine == list(self._claims):
            return
        self._claims = mine
        if mine:
            self.ask("caution", self._text_of_claims, lambda: self.tr("Agree which station goes on with it."))
        else:
            self.dismiss()

    def _text_of_claims(self) -> str:
        messages = [claim.message for claim in self._claims]
        return "\n".join(event_sentence(message.id, message.values) for message in messages)
