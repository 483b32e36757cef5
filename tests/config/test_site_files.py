"""Site files are validated by the rules of their loaders, with line numbers, and edited without losing comments."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from calstation.config import check, edit_toml, library, line_of, normal_gravity_at, read_text, site_advice
from calstation.config.editing import MODELS, list_files, new_name, warnings
from calstation.errors import ConfigurationError
from calstation.messages import sentence
from calstation.schema import KeyPath, Problem, load
from tests.site_folder import PRODUCT

CHANGED_LINE, HEADER_LINE = "the changed line", "its table's header"
SHIPPED = [(kind, path) for kind in MODELS for path in (library.shipped_folder() / kind).glob("*.toml")]


def shipped(kind: str, name: str) -> str:
    return read_text(library.shipped_folder() / kind / f"{name}.toml")


def problems_after(kind: str, name: str, old: str, new: str) -> list[Problem]:
    """Return the problems found after one change of a shipped file."""
    text = shipped(kind, name)
    assert old in text
    return check(kind, text.replace(old, new, 1))


@pytest.mark.parametrize(("kind", "path"), SHIPPED, ids=lambda value: getattr(value, "stem", value))
def test_every_shipped_file_is_valid(kind: str, path: Path) -> None:
    assert check(kind, read_text(path)) == []
    assert warnings(kind, read_text(path)) == []


def test_limits_that_no_stage_of_the_product_judges_are_warned_about() -> None:
    """A limit must not be ignored silently; a group whose rest has own limits is judged as its remaining parameters."""
    limits = {
        "gyro_bias": {"within": 1.5e-5},
        "accel_bias": {"within": 0.0074},
        "accel_scale_x": {"within": 1e-3},
        "gyro_scale_y": {"within": 2e-3},
        "secondary_gyro_bias": {"within": 1e-4},
        "gyro_cubic": {"within": 1.0},
    }
    text = tomli_w.dumps({**PRODUCT, "stages": ["six_position"], "limits": limits})
    assert check("products", text) == []
    found = warnings("products", text)
    assert [problem.key_path[1] for problem in found] == [
        *("gyro_bias", "gyro_scale_y", "secondary_gyro_bias", "gyro_cubic"),
    ]
    first = found[0]
    assert text.splitlines()[first.line - 1] == "[limits.gyro_bias]"
    assert "No stage of the product (Six positions) determines gyro_bias" in first.text
    assert "Add a stage that determines it to 'stages', or remove the limit." in first.text
    assert "陀螺零偏" in sentence(first.as_text, "zh_CN", window=True)
    assert warnings("products", tomli_w.dumps(PRODUCT)) == []


@pytest.mark.parametrize(
    ("kind", "name", "old", "new", "where", "message"),
    [
        ("products", "nav_a", "turns = 2", "turns = 0", CHANGED_LINE, "schedule.rate.turns: 0 is out of range"),
        ("products", "nav_a", "rounds = 1", "round = 1", CHANGED_LINE, "Did you mean 'rounds'?"),
        ("products", "nav_a", '"rate"', '"rat"', CHANGED_LINE, "There is no stage 'rat'"),
        (
            "products",
            "nav_a",
            'imu = "bench_nav"',
            'imu = "x"',
            CHANGED_LINE,
            "imu: There is no IMU profile “x”. Choose from",
        ),
        ("products", "nav_a", "name =", "name", CHANGED_LINE, "not valid TOML: Expected '='"),
        (
            "imus",
            "bench_nav",
            '"gyro_z", type = "i32"',
            '"gyro_z", type = "i33"',
            CHANGED_LINE,
            'frame.fields["gyro_z"].type',
        ),
        ("imus", "bench_nav", "sigma = 2.5e-05", "sigma = -1.0", CHANGED_LINE, "prior.gyro_bias.sigma: -1.0"),
        ("imus", "bench_nav", "address = 12", "address = 11", CHANGED_LINE, "overlap"),
        (
            "imus",
            "bench_nav",
            '"gyro_scale_x", ',
            '"gyro_scal_x", ',
            CHANGED_LINE,
            "'gyro_scal_x' is not a parameter",
        ),
        ("imus", "bench_nav", "range = [-2.0, 2.0]", "range = [-0.001, 2.0]", CHANGED_LINE, "Widen the range"),
        ("imus", "bench_nav", 'name = "gyro_x"', 'name = "gyrox"', CHANGED_LINE, "'gyrox' is unknown"),
        (
            "imus",
            "bench_nav",
            'crc16_ccitt_false", start = 2',
            'crc16_ccitt_false", start = 99',
            CHANGED_LINE,
            "crc.start: Byte 99",
        ),
        (
            "imus",
            "vectornav_vn100",
            "reach = 156.9 }, # ±16 g",
            "per_sample = 2.0 },",
            CHANGED_LINE,
            "Only the counter has a per_sample",
        ),
        (
            "imus",
            "vectornav_vn100",
            '"accel_quadratic", "inner',
            '"accel_quadratc", "inner',
            CHANGED_LINE,
            "Did you mean",
        ),
        (
            "tables",
            "mn_ascii",
            'stop = ["STP,{axis}"]',
            'stop = ["STP,{angle}"]',
            CHANGED_LINE,
            "'{angle}' is unknown here",
        ),
        ("tables", "mn_ascii", "rate = { send", "rat = { send", HEADER_LINE, "queries.rate: The entry is missing"),
        (
            "tables",
            "mn_ascii",
            "moving = { query",
            "movin = { query",
            CHANGED_LINE,
            "flags.movin: The entry is unknown",
        ),
        (
            "tables",
            "bench",
            'outer_target = { address = 34, type = "i32"',
            'outer_target = { address = 34, type = "i16"',
            CHANGED_LINE,
            "registers.outer_target: Type i16",
        ),
        ("tables", "bench", "stop = 2", "stop = 70000", CHANGED_LINE, "commands.stop: 70000 does not fit"),
        ("tables", "bench", "homed = 12", "homed = 16", CHANGED_LINE, "status_bits.homed: 16 is out of range"),
        ("stations", "virtual_bench", "seed = 1", "seed = -1", CHANGED_LINE, "bench.seed: -1 is out of range"),
        (
            "stations",
            "virtual_bench",
            'profile = "bench"',
            'profile = "x"',
            CHANGED_LINE,
            "table.profile: There is no table profile “x”",
        ),
        ("stations", "example_hardware", "timeout_s = 1.0", "timeout_s = 'long'", CHANGED_LINE, "imu.timeout_s"),
        ("stations", "example_hardware", 'port = "tcp', 'prt = "tcp', CHANGED_LINE, "Did you mean 'port'?"),
    ],
)
def test_problem_of_an_entry_has_its_line_number(
    kind: str, name: str, old: str, new: str, where: str, message: str
) -> None:
    problem = problems_after(kind, name, old, new)[0]
    assert message in problem.text
    lines = (shipped(kind, name).split(old)[0] + old).splitlines()
    header = max((i for i, text in enumerate(lines, 1) if text.startswith("[")), default=0)
    assert problem.line == (header if where == HEADER_LINE else len(lines))


def test_all_problems_are_found() -> None:
    text = shipped("stations", "example_hardware").replace("34.25", '"x"').replace("400.0", "1e9")
    assert [p.key_path for p in check("stations", text)] == [("site", "latitude_deg"), ("site", "height_m")]


def test_validation_and_loader_agree(tmp_path: Path) -> None:
    text = shipped("tables", "bench").replace("low_deg = -1080.0", "low_deg = 2000.0", 1)
    path = tmp_path / "bench.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load(MODELS["tables"], path)
    assert str(caught.value) == f"{path}: {check('tables', text)[0].text}"


def test_change_preserves_comments_and_order() -> None:
    before = shipped("stations", "example_hardware")
    after = edit_toml(
        before,
        {
            ("site", "latitude_deg"): 12.5,
            ("site", "gravity_mps2"): 9.8,
            ("table", "serial", "baud"): 19200,
            ("imu", "timeout_s"): None,
            ("imu", "serial"): None,
        },
    )
    assert check("stations", after) == []
    for comment in ("copy this file", "or a serial port for Modbus RTU", "leave out where it is not known"):
        assert comment in after
    data = tomllib.loads(after)
    assert data["site"]["latitude_deg"] == 12.5
    assert data["site"]["gravity_mps2"] == 9.8
    assert data["table"]["serial"] == {"baud": 19200}
    assert data["imu"] == {"port": "/dev/ttyUSB0"}


@pytest.mark.parametrize(
    ("name", "key_path", "before", "after"),
    [
        ("dsp_modbus", ("noise", "gyro_arw"), "# rad/√s, 0.15 °/√h", "# rad/√s"),
        ("bench_mems", ("noise", "gyro_arw"), "# rad/√s, 0.15 °/√h", "# rad/√s"),
        ("stim300", ("noise", "accel_vrw"), "# m/s/√s, 0.06 m/s/√h", "# m/s/√s"),
        ("stim300", ("stream", "gyro_lsb"), "# rad/s: 2^-14 °/s", "# rad/s"),
        ("novatel_rawimu", ("stream", "gyro_lsb"), "# 0.1/(3600 · 256) rad", "# rad"),
        ("novatel_rawimu", ("prior", "accel_bias", "sigma"), "# m/s², 50 mg", "# m/s²"),
        ("stim300", ("link", "baud"), "# as ordered: 374400, 460800", None),
        ("text_lines", ("link", "baud"), "# a line of 80 characters", None),
        ("text_lines", ("stream", "gyro_lsb"), "# the lines tell rad/s; of °/s write 0.0174", None),
    ],
)
def test_comment_does_not_repeat_the_previous_value_in_another_unit(
    name: str, key_path: KeyPath, before: str, after: str | None
) -> None:
    text = shipped("imus", name)
    value: Any = tomllib.loads(text)
    for key in key_path:
        value = value[key]
    assert before in edit_toml(text, {key_path: value}), "the value is the same"
    changed = edit_toml(text, {key_path: 2 * value}).splitlines()
    (old,) = set(text.splitlines()) - set(changed)
    (new,) = set(changed) - set(text.splitlines())
    assert before in old
    assert new.split(" #")[1] == (old.split(" #")[1] if after is None else after.removeprefix("#"))


@pytest.mark.parametrize(
    ("comment", "kept"),
    [
        *((text, "m") for text in ("m, 300 mm", "m: ±3e-1 m", "m; 3.0e+2 mm")),
        *((text, "rad/s") for text in ("rad/s, 1 °/h", "rad/s, -5 °/h", "rad/s: 2^-14 °/s")),
        *(("1, 300 ppm", "1"), ("1, 0.03 %", "1"), ("m/s², 0.25 mg", "m/s²"), ("0.05/2^15 m/s", "m/s")),
        *((text, text) for text in ("m, measured 2024 with rod 3", "K, see report 17/2024", "1: see note 3")),
        *((text, text) for text in ("m, 3 m from door 2", "rad/s, 1 °/h at 20 °C", "rad/s, 1 °/h; order 2024")),
        *((text, text) for text in ("1, 2 or 3", "1: ±2 g", "1-3 m", "see # m, 3 mm", "±500 °/s", "2^-14 °/s")),
        *((text, text) for text in ("m/s²: 2^-19 g; 2^-20 g for 5 g, 2^-18 g for 30 g", "rad/s, 1 and 20 °/h")),
    ],
)
def test_change_removes_only_a_comment_that_is_a_conversion(comment: str, kept: str) -> None:
    changed = edit_toml(f"[t]\nx = 0.3  # {comment}\ny = 1\n", {("t", "x"): 0.5})
    assert changed == f"[t]\nx = 0.5  # {kept}\ny = 1\n"


def test_removing_the_last_value_removes_the_table() -> None:
    text = '[imu]\nport = "x" # here\n\n[imu.serial]\nbaud = 1\n'
    assert tomllib.loads(edit_toml(text, {("imu", "serial", "baud"): None})) == {"imu": {"port": "x"}}
    assert edit_toml(text, {("imu", "other"): None}) == text


KEYS = st.text(alphabet="abc", min_size=1, max_size=3)
VALUES = st.one_of(st.integers(-9, 9), st.booleans(), st.text(alphabet='a"# ]\\', max_size=4))
DATA = st.recursive(
    st.dictionaries(KEYS, VALUES, min_size=1, max_size=3),
    lambda inner: st.dictionaries(
        KEYS, st.one_of(VALUES, inner, st.lists(VALUES, max_size=3), st.lists(inner, min_size=1, max_size=2)),
        min_size=1, max_size=3,
    ),
    max_leaves=12,
)  # fmt: skip


@given(DATA)
def test_line_of_every_value_is_found(data: dict[str, object]) -> None:
    import tomli_w

    text = tomli_w.dumps(data, multiline_strings=False)
    lines = text.splitlines()

    def walk(value: object, key_path: tuple[str | int, ...]) -> None:
        if isinstance(value, dict):
            for key, inner in value.items():
                walk(inner, (*key_path, key))
        elif isinstance(value, list):
            for i, inner in enumerate(value):
                walk(inner, (*key_path, i))
        else:
            line = lines[line_of(text, key_path) - 1]
            assert repr(value).lower() in line.lower() or isinstance(value, str)
            assert isinstance(key_path[-1], int) or key_path[-1] in line

    walk(data, ())


def test_site_file_overrides_the_shipped_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path))
    assert all(entry.shipped for entry in list_files("tables"))
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "bench.toml").write_text("", encoding="utf-8")
    (entry,) = [entry for entry in list_files("tables") if entry.name == "bench"]
    assert (entry.shipped, entry.path) == (False, tmp_path / "tables" / "bench.toml")
    assert new_name("tables", "mine-2") == "mine-2"
    for bad in ("", "../x", "a b", "-x", "bench"):
        with pytest.raises(ConfigurationError):
            new_name("tables", bad)


def test_normal_gravity_requires_a_valid_location() -> None:
    assert normal_gravity_at(45.0, 0.0) == pytest.approx(9.80620, abs=1e-5)
    assert normal_gravity_at(None, 0.0) is None
    assert normal_gravity_at(91, 0) is None


def test_impossible_gravity_gives_a_warning_with_the_resulting_error() -> None:
    right = normal_gravity_at(34.25, 400.0)
    assert right is not None
    assert site_advice(34.25, 108.9, 400.0, 0.0, right * (1 + 2.9e-4)) == ()
    assert [f.id for f in site_advice(34.25, 108.9, 400.0, 0.0, round(right, 5))] == ["gravity_normal"]
    (found,) = site_advice(34.25, 108.9, 400.0, 0.0, right * (1 + 1.2e-3))
    assert found.id == "gravity_off"
    assert found.values["ppm"] == pytest.approx(1200.0)
    assert site_advice("x", 1.0, None, 0.0, 9.8) == ()  # type: ignore[arg-type]


def test_computed_gravity_with_the_sigma_of_a_survey_gives_a_warning() -> None:
    location, own = (34.25, 108.9, 400.0, 0.0), {None: [], 5e-4: [], 1e-3: []}
    for sigma, ids in {**own, 1e-6: ["gravity_sigma_small"], 1e-4: ["gravity_sigma_small"], "x": []}.items():
        assert [f.id for f in site_advice(*location, None, sigma)] == ids  # type: ignore[arg-type]
        assert site_advice(*location, 9.7961, sigma) == ()  # type: ignore[arg-type]


def test_improbable_locations_give_a_warning() -> None:
    assert [f.id for f in site_advice(0.0, 0.0, 0.0, 0.0, None)] == ["null_island"]
    assert [f.id for f in site_advice(-85.0, 10.0, 0.0, None, None)] == ["azimuth_hopeless"]
    assert site_advice(-85.0, 10.0, 0.0, 12.0, None) == ()


def test_instrument_due_before_its_calibration_is_refused() -> None:
    dates = "calibrated = 2026-03-01\ndue = 2025-03-01"
    text = shipped("stations", "virtual_bench") + f'\n[[instruments]]\nname = "Table"\nkind = "table"\n{dates}\n'
    (problem,) = check("stations", text)
    assert problem.key_path == ("instruments", 0, "due")
    assert problem.what.code == "station.due_before_calibration"
    assert check("stations", text.replace("2025-03-01", "2027-03-01")) == []


@pytest.mark.parametrize(
    ("entry", "key_path", "code"),
    [
        ('[laboratory]\nname = "L"\naddress = "A"\ncountry = "UK"', ("laboratory", "country"), "station.not_a_country"),
        ('[[instruments]]\nname = "Table"', ("instruments", 0, "kind"), "station.no_instrument_kind"),
    ],
)
def test_unknown_country_and_instrument_without_kind_are_refused(
    entry: str, key_path: tuple[str | int, ...], code: str
) -> None:
    text = f"{shipped('stations', 'virtual_bench')}\n{entry}\n"
    (problem,) = check("stations", text)
    assert (problem.key_path, problem.what.code) == (key_path, code)
    assert check("stations", text.replace("UK", "GB").replace('"Table"', '"Table"\nkind = "table"')) == []


def test_station_in_the_documentation_is_valid() -> None:
    guide = (Path(__file__).parents[2] / "docs" / "how-to" / "connect.md").read_text(encoding="utf-8")
    (station,) = [t for t in re.findall(r"```toml\n(.*?)```", guide, re.DOTALL) if "[site]" in t]
    assert check("stations", station) == []
    named = {
        "tables": ("bench", "aerosmith_atl", "acutronic_acl", "mn_ascii"),
        "imus": ("bench_nav", "stim300", "vectornav_vn100", "dsp_modbus"),
    }
    for kind, names in named.items():
        for name in names:
            assert f"`{name}`" in guide
            assert name in library.names(kind)
