"""The database shared by several stations: its tables, the exchange of a station with it, and the archive of logs.

The files of a station remain authoritative and no run waits for the database. The package contains no solvers.
"""

from calstation.database.archiver import LogArchiver
from calstation.database.connect import connect, database_of, failure, open_database, upgrade
from calstation.database.exchange import Exchange
from calstation.database.outbox import ArchivedLog, Outbox, adopt_folder
from calstation.database.process import ExchangeProcess, exchange_once, start_exchange, watch
from calstation.database.remote import (
    export_shared_runs,
    fetch_log,
    fetch_result,
    is_archived,
    load_shared_results,
    note_use,
)
from calstation.database.state import Claim, ExchangeState, read_state
from calstation.database.tables import locations, log_copies, revisions, runs, solutions, versions
