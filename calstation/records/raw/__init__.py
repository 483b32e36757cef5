"""The raw log, an HDF5 file: how it is written and read, also while it is written, and after damage.

The content of logs belongs in `calstation.records.meta` and `calstation.records.log`.
"""

from calstation.records.raw.raw_log import RESERVED_SPACE, SUFFIX, RawLogWriter, write_log
from calstation.records.raw.raw_read import (
    END_BY_OPERATOR,
    END_FAILING,
    being_written,
    can_be_resumed,
    completed_points,
    completed_rounds,
    last_result,
    open_raw,
    raw_rows,
    row_count,
    solved_stages,
    stages_ended_by_hand,
    step_labels,
    unsolved_stages,
)
