"""Notice that another station works on the unit of this station."""

from collections.abc import Sequence

from calstation.database import Claim
from calstation.gui.state import AppContext
from calstation.gui.text import say
from calstation.gui.widgets import NoticeBar
from calstation.messages import event_text


class ClaimNotice(NoticeBar):
    """Shows other stations' claims on the unit claimed by this station; they do not prevent a run."""

    def __init__(self, app: AppContext) -> None:
        super().__init__("claim_notice")
        self._app = app
        self._claims: Sequence[Claim] = ()
        app.exchange_changed.connect(self._refresh)
        app.claim_changed.connect(self._refresh)
        app.engine_link.running_changed.connect(self._running_changed)

    def _running_changed(self, running: bool) -> None:
        request = self._app.engine_link.request
        if request is None or self._app.run.register_operation:
            return
        if running:
            self._app.claim(*filter(None, request.serials or (request.serial,)))
        elif request.serial in self._app.claimed:  # not for the next unit
            self._app.claim()

    def _refresh(self) -> None:
        state, claimed = self._app.exchange_state, self._app.claimed
        mine = [] if state is None else [claim for claim in state.claims if claim.serial in claimed]
        if mine == list(self._claims):
            return
        self._claims = mine
        if mine:
            self.ask("caution", self._text_of_claims, "operator.agree_station")
        else:
            self.dismiss()

    def _text_of_claims(self) -> str:
        messages = [claim.message for claim in self._claims]
        return "\n".join(say(event_text(message.id, message.values)) for message in messages)
