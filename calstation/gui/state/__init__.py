"""State and widgets that the pages share: the context, the status of the run, the role, and panels for a run.

Widgets that do not depend on runs belong in `calstation.gui.widgets`. The package has more than 15 modules: one for
each state, such as that of the run, the table or the ports, and one for each panel that several pages show.
"""

from calstation.gui.state.chamber_notice import ChamberNotice, chamber_reason, thing_text
from calstation.gui.state.context import AppContext
from calstation.gui.state.event_log import EventLog
from calstation.gui.state.page import FileExport, JobView, Page
from calstation.gui.state.people_panel import PeoplePanel, ReleaseBar, ask_to_sign_in
from calstation.gui.state.port_watch import prevented_by
from calstation.gui.state.reset_bar import ResetBar, TableNotice
from calstation.gui.state.role import RolePanel
from calstation.gui.state.run_status import RunStatus
from calstation.gui.state.run_strip import (
    EndStageButton,
    ExchangeLabel,
    PauseButton,
    RunStrip,
    needs_no_run,
    run_badge,
    run_title,
)
from calstation.gui.state.slots import LEAVING, EarlierRuns, Slot, Slots
from calstation.gui.state.unit_status import TRANSFER, StageState, UnitStatus, largest_sigmas, stage_rows
