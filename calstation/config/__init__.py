"""Stations, products, profile library, resolved run configuration, editing, versions and access rights."""

from calstation.config import access, editing, library, versions
from calstation.config.batch import batch_bench_config, new_batch_id, prepare_batch, unit_requests
from calstation.config.blocks import arrange_entries
from calstation.config.check_standards import CheckStandardSection
from calstation.config.confirmation import (
    Action,
    ConfirmationRequired,
    Person,
    confirm,
    confirmation_required,
    pin_known,
)
from calstation.config.editing import check, detect_kind, edit_toml, line_of, read_text
from calstation.config.forms import FORMS, Form, FormCell, FormColumn, FormRow, cells_with_problem
from calstation.config.laboratory import InstrumentSection, LaboratorySection, ReportSection, missing_report_places
from calstation.config.library import locate, pair_folder, site_folder
from calstation.config.link_defaults import LinkDefaults, imu_defaults, is_manual_table, table_defaults
from calstation.config.pair import PairConfiguration, resolve_pair
from calstation.config.product import (
    DEFAULT_PRODUCT,
    ProductConfig,
    in_file,
    load_product,
    manual_product,
    schedule_values,
)
from calstation.config.records import RecordsSection, check_database_url, has_password
from calstation.config.request import Confirmation, RegisterOperation, RunRequest, computer_user, plain_text
from calstation.config.resolved import (
    ManualRigError,
    ResolvedConfiguration,
    check_manual_rig,
    prepare_run,
    resolve_configuration,
    unit_files,
)
from calstation.config.schedules import (
    ScheduleField,
    ScheduleOptions,
    ScheduleProblem,
    save_schedule,
    schedule_fields,
    schedule_options,
    schedule_problems,
)
from calstation.config.sign_in import SignInSection
from calstation.config.site_check import (
    confirmation_key,
    gravity_beyond,
    gravity_contradiction,
    is_confirmed,
    needs_surveyed_gravity,
    normal_gravity_at,
    site_advice,
    this_computer,
)
from calstation.config.slot_form import SLOTS, with_one_unit, with_slots
from calstation.config.slots import MAX_UNITS, SlotSection, takes_one_unit
from calstation.config.station import (
    DEFAULT_STATION,
    MANUAL_STATION,
    VIRTUAL_UNIT,
    StationConfig,
    at_slot,
    load_station,
    uses_manual_rig,
)
from calstation.config.summary import RunSummary, compatible_products, run_summary
from calstation.config.versions import Version, save_noise
