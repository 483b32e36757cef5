"""Configuration files of stations and products, their editing, and the configuration of a run.

The package depends on no device, task or bench. It has more than 15 modules, one for each kind or section of files.
"""

from calstation.config import access, editing, library, versions
from calstation.config.blocks import arrange_entries
from calstation.config.compatible import compatible_products, product_error, with_product
from calstation.config.configuration_checks import (
    ManualRigError,
    check_chamber,
    check_manual_rig,
    check_station,
    temperature_ranges,
)
from calstation.config.confirmation import (
    Action,
    ConfirmationRequired,
    Person,
    can_confirm_identity,
    confirm,
    confirm_at_site,
    confirmation_required,
    require_no_pin,
    unlisted_engineer,
)
from calstation.config.editing import check, detect_kind, edit_toml, line_of, read_text
from calstation.config.file_forms import FORMS, reference_form
from calstation.config.forms import (
    FieldSpec,
    Form,
    FormCell,
    FormColumn,
    FormRow,
    cells_with_problem,
    field_spec,
)
from calstation.config.library import locate, pair_folder, site_folder
from calstation.config.pair import PairConfiguration, load_pair_configuration, require_one_temperature
from calstation.config.product import (
    DEFAULT_PRODUCT,
    CheckStandardSection,
    DetectionSection,
    ProductConfig,
    in_file,
    known_products,
    load_product,
    manual_product,
    schedule_values,
)
from calstation.config.request import Confirmation, RegisterOperation, RunRequest, computer_user, plain_text
from calstation.config.run_configuration import (
    RunConfiguration,
    load_configuration,
    new_batch_id,
    prepare_units,
    unit_files,
    unit_requests,
)
from calstation.config.schedules import (
    ScheduleOptions,
    implied_targets,
    save_schedule,
    schedule_fields,
    schedule_options,
    schedule_problems,
)
from calstation.config.site_check import (
    confirmation_key,
    excess_gravity_sigma,
    gravity_contradiction,
    is_confirmed,
    needs_surveyed_gravity,
    normal_gravity_at,
    site_advice,
    this_computer,
)
from calstation.config.slot_form import SLOTS, with_one_unit, with_slots
from calstation.config.slots import (
    STATION_ENTRIES,
    LinkDefaults,
    SlotSection,
    chamber_defaults,
    imu_defaults,
    is_manual_table,
    profile_takes_single_unit,
    table_defaults,
)
from calstation.config.station import (
    DEFAULT_STATION,
    MANUAL_STATION,
    VIRTUAL_UNIT,
    BenchSettings,
    StationConfig,
    at_slot,
    load_bench,
    load_station,
    uses_manual_rig,
    virtual_serials,
)
from calstation.config.station_forms import BADGES, INSTRUMENTS, SIGNATORIES
from calstation.config.station_sections import (
    InstrumentSection,
    ReportSection,
    SignInSection,
    check_database_url,
    has_password,
    missing_report_paths,
)
from calstation.config.trail import (
    SiteTrail,
    TrailLine,
    export_trail,
    read_site_trail,
    read_trail_copy,
    restart_site_trail,
)
from calstation.config.trail_values import trail_values
from calstation.config.versions import Version, save_noise
