"""A result file that differs from its log gives no certificate, whichever entry was changed."""

import json
import shutil
import types
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from calstation.cli.app import run_app
from calstation.config import Person, access
from calstation.errors import InputError
from calstation.judgement import Check
from calstation.messages import sentence
from calstation.records import audit_path, open_log
from calstation.reports import source
from calstation.results import Resolved, Result, load_result, override_result, resolve
from tests.helpers import ignore_progress, raises_code
from tests.reports.certificates import make, with_laboratory
from tests.shared_runs import SharedRuns
from tests.site_folder import ONE_STAGE, SiteFolder

#: Beginnings of entries that the certificate does not take from the file: a change of them has no effect.
WITHOUT_EFFECT = {
    "run": ("closed_utc.", "closed_by.", "log.file"),
    "solved_again": ("log.file", "details.", "observability."),
}
#: Errors of a file that was changed.
REFUSED = {"report.other_result", "result.altered", "report.other_log", "result.release_unknown", "report.untested"} | {
    "report.solved_by_other_version",
    "result.not_a_result",
}
OVERDUE = {"name": "rate table", "kind": "table", "due": date(2020, 1, 2)}
FIELDS = [field.serialization_alias or field.alias or name for name, field in Result.model_fields.items()]


@dataclass(frozen=True)
class Honest:
    """A result file, its content, and the result that its certificate states."""

    path: Path
    content: dict[str, Any]
    stated: dict[str, Any]


@pytest.fixture(scope="module")
def made(shared_runs: SharedRuns, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a run in the folder of its result."""
    return make(shared_runs, tmp_path_factory.mktemp("made"), "gimbal").result_file.with_suffix(".h5")


@pytest.fixture(scope="module")
def solution(made: Path) -> Result:
    """The result of the re-solved log."""
    return resolve(made).result


@pytest.fixture
def run(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Honest:
    """The result of a run with its log, which is read only once."""
    return copied(made, tmp_path, json.loads(made.with_suffix(".json").read_text(encoding="utf-8")), monkeypatch)


@pytest.fixture
def solved_again(made: Path, solution: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Honest:
    """The result of a re-solved log, which the certificate does not solve again."""
    monkeypatch.setattr(source, "resolve_log", lambda *arguments, **more: Resolved(solution, ()))
    return copied(made, tmp_path, solution.to_json(), monkeypatch)


def copied(made: Path, folder: Path, content: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> Honest:
    log = Path(shutil.copy(made, folder))
    opened = open_log(log)
    opened.facts()
    monkeypatch.setattr(source, "open_log", lambda path: opened if path == log else open_log(path))
    log.with_suffix(".json").write_text(json.dumps(content), encoding="utf-8")
    return honest(log.with_suffix(".json"))


def honest(path: Path) -> Honest:
    """A result file that refers to the log in its folder."""
    content = json.loads(path.read_text(encoding="utf-8"))
    content["log"]["file"] = str(path.with_suffix(".h5"))
    path.write_text(json.dumps(content), encoding="utf-8")
    return Honest(path, content, stated(path))


def stated(path: Path) -> dict[str, Any]:
    """Return the result stated by the certificate of a file."""
    return source.load_source(ignore_progress, path)[0].to_json()


def forged(value: Any) -> Any:
    """Return a different value of the same type."""
    match value:
        case bool():
            return not value
        case int() | float():
            return value + 1
        case str():
            return f"{value} forged"
        case None:
            return 1.0
    raise AssertionError(value)


def forgeries(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield every change of one entry of a JSON value with its path; of similar rows only the first is changed."""
    if isinstance(value, dict):
        alike = len({type(row) for row in value.values()}) == 1 and isinstance(next(iter(value.values())), dict)
        for key in list(value)[:1] if alike else value:
            for place, other in forgeries(value[key]):
                yield f"{key}.{place}".removesuffix("."), {**value, key: other}
            yield f"without {key}", {name: row for name, row in value.items() if name != key}
    elif isinstance(value, list):
        yield "emptied" if value else "added", [] if value else ["forged"]
        for place, other in forgeries(value[0]) if value else ():
            yield f"0.{place}".removesuffix("."), [other, *value[1:]]
    else:
        yield "", forged(value)


def example(annotation: Any, field: FieldInfo | None = None) -> Any:
    """Return a JSON value of a type, for an entry missing in the file."""
    arguments = [argument for argument in get_args(annotation) if argument is not type(None)]
    origin = get_origin(annotation)
    if origin in (Union, types.UnionType, Annotated):
        return example(arguments[0])
    if origin is Literal:
        return arguments[0]
    if origin is list or annotation is list:
        return [example(arguments[0])]
    if origin is tuple:
        return [example(argument) for argument in arguments if argument is not ...]
    if origin is dict or annotation is dict:
        return {"forged": example(arguments[1])}
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        fields = annotation.model_fields.items()
        return {name: example(field.annotation) for name, field in fields if field.is_required()}
    if annotation is Check:
        return {"name": "forged", "value": 1.0, "limit": 2.0, "unit": "1", "passed": True}
    return {bool: True, int: 7, float: 1.5, str: "forged"}.get(annotation, "forged")


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("kind", ["run", "solved_again"])
def test_modified_result_entry_never_reaches_a_certificate(
    kind: str, name: str, request: pytest.FixtureRequest
) -> None:
    case: Honest = request.getfixturevalue(kind)
    field = next(f for n, f in Result.model_fields.items() if name in (n, f.alias, f.serialization_alias))
    rest = {key: value for key, value in case.content.items() if key != name}
    changes = [("", rest)] if name in case.content else [("", {**rest, name: example(field.annotation)})]
    if name in case.content:
        changes += [(place, {**rest, name: value}) for place, value in forgeries(case.content[name])]
    for place, content in changes:
        entry = f"{name}.{place}"
        case.path.write_text(json.dumps(content), encoding="utf-8")
        if entry.startswith(WITHOUT_EFFECT[kind]):
            assert stated(case.path) == case.stated
        else:
            with pytest.raises(InputError) as caught:
                pytest.fail(f"{entry} was not refused: {stated(case.path)[name]}")
            assert caught.value.code in REFUSED, (entry, caught.value.code)


def test_digest_of_the_log_is_compared_even_if_missing_in_the_result(run: Honest) -> None:
    log = {**run.content["log"], "sha256": ""}
    run.path.write_text(json.dumps({**run.content, "log": log}), encoding="utf-8")
    with raises_code(InputError, "report.other_log") as caught:
        stated(run.path)
    assert "or was changed after it was solved" in str(caught.value)
    assert "或在解算后被改动" in sentence(caught.value.as_text, "zh_CN")


def test_rounding_differences_of_another_computer_are_accepted_but_not_printed(solved_again: Honest) -> None:
    content = json.loads(json.dumps(solved_again.content))
    row = next(iter(content["parameters"].values()))
    row["value"] += 5e-4 * row["sigma"]
    solved_again.path.write_text(json.dumps(content), encoding="utf-8")
    assert stated(solved_again.path) == solved_again.stated
    row["value"] += 1e-3 * row["sigma"]
    solved_again.path.write_text(json.dumps(content), encoding="utf-8")
    with raises_code(InputError, "report.other_result"):
        stated(solved_again.path)


def test_range_and_stages_in_the_result_are_solved_again(run: Honest) -> None:
    first, last = run.content["log"]["first_seq"], run.content["log"]["last_seq"]
    log = run.path.with_suffix(".h5")
    found = resolve(log, tuple(run.content["stages"]), first + 10, last).result
    path = run.path.with_name("part.json")
    path.write_text(json.dumps(found.to_json()), encoding="utf-8")
    assert stated(path)["parameters"] == found.to_json()["parameters"]
    assert stated(path)["log"]["first_seq"] == first + 10


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("unit", {"serial": "SN-7"}),
        ("started_utc", "2020-01-01T00:00:00+00:00"),
        ("operator", "somebody"),
        ("temperature_c", {"mean": 20.0, "min": 20.0, "max": 20.0}),
        ("configuration", {}),
        ("attempt", 5),
        ("duration_s", 1.0),
        ("slot", "left"),
    ],
)
def test_result_in_the_log_that_contradicts_the_log_is_not_certified(
    run: Honest, entry: str, value: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever edits the result in the log too must also change its configuration and samples, and so its digest."""
    path = run.path.with_suffix(".h5")
    log = source.open_log(path)
    monkeypatch.setattr(log, "results", [{**log.results[-1], entry: value}])
    with raises_code(InputError, "report.contradicts_log"):
        stated(path)


@pytest.mark.parametrize("acting", [True, False], ids=["acting on the output", "not acting"])
def test_registers_as_found_are_those_of_the_log(run: Honest, acting: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    path = run.path.with_suffix(".h5")
    log = source.open_log(path)
    found, other = {"gyro_bias_x": 1e-6}, {"old": {"gyro_bias_x": 2e-6}}
    monkeypatch.setattr(log, "events", [{"event": "OldRegisters", "registers": {} if acting else found}])
    if acting:
        meta = log.meta.model_copy(update={"registers": found})
        monkeypatch.setattr(log, "meta", meta)
        monkeypatch.setattr(log, "_facts", None)
        monkeypatch.setattr(log, "stored_sha256", None)
    sha256 = log.facts().sha256
    configuration = source.stated_by_log(log.meta, log.facts())["configuration_sha256"]
    content = {**log.results[-1], "configuration_sha256": configuration}
    content["log"] = {**content["log"], "sha256": sha256}
    monkeypatch.setattr(log, "results", [{**content, "registers": {"old": found}}])
    assert stated(path)["registers"]["old"] == found
    monkeypatch.setattr(log, "results", [{**content, "registers": other}])
    with raises_code(InputError, "report.contradicts_log"):
        stated(path)


def test_run_result_requires_the_log_that_contains_it(run: Honest, capsys: pytest.CaptureFixture[str]) -> None:
    csv = run.path.with_name("export.csv")
    assert run_app(["export", str(run.path.with_suffix(".h5")), "-o", str(csv)]) == 0
    log = {**run.content["log"], "file": str(csv), "sha256": open_log(csv).facts().sha256}
    run.path.write_text(json.dumps({**run.content, "log": log}), encoding="utf-8")
    with raises_code(InputError, "report.no_result_in_log"):
        stated(run.path)


@pytest.fixture
def released(shared_runs: SharedRuns, tmp_path: Path) -> Path:
    """The result of a failed run whose unit was released at this site."""
    path = make(shared_runs, tmp_path / "site", "failed").result_file
    honest(path)
    access.set_pin("", "000000")
    override_result(ignore_progress, path, "shock test", Person("wang", "000000"), None)
    return path


@pytest.mark.long
def test_release_is_certified_only_if_it_is_in_the_audit_trail(released: Path, home: Path) -> None:
    assert stated(released)["override"]["why"] == "shock test"
    for key, value in (("by", "li"), ("confirmed_by", "li"), ("why", "none"), ("utc", "2001-01-01T00:00:00+00:00")):
        content = json.loads(released.read_text(encoding="utf-8"))
        other = released.with_name("other.json")
        other.write_text(json.dumps({**content, "override": {**content["override"], key: value}}), encoding="utf-8")
        with raises_code(InputError, "result.release_unknown"):
            stated(other)
    lines = audit_path(home).read_bytes().splitlines(keepends=True)
    audit_path(home).write_bytes(b"".join([lines[0].replace(b"pin_set", b"pin_get"), *lines[1:]]))
    with raises_code(InputError, "result.release_unconfirmed"):
        stated(released)
    shutil.rmtree(home)
    with raises_code(InputError, "result.release_unknown"):
        stated(released)


@pytest.mark.long
def test_release_of_another_run_does_not_apply(released: Path, shared_runs: SharedRuns, tmp_path: Path) -> None:
    other = make(shared_runs, tmp_path / "other", "gimbal").result_file
    release = load_result(released).override
    assert release is not None
    content = honest(other).content
    other.write_text(json.dumps({**content, "override": release.model_dump()}), encoding="utf-8")
    with raises_code(InputError, "result.release_unknown"):
        stated(other)


@pytest.mark.long
def test_failed_check_cannot_be_changed_to_passed(
    shared_runs: SharedRuns, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = make(shared_runs, tmp_path / "site", "failed").result_file
    path.write_text(json.dumps({**honest(path).content, "outcome": "passed", "passed": True}), encoding="utf-8")
    assert run_app(["report", str(path), "-o", str(tmp_path / "edited.pdf")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "was changed: it differs from the result in its log" in said
    assert '"failed" in the log, "passed" in the file' in said or "false in the log, true in the file" in said
    assert not (tmp_path / "edited.pdf").exists()


@pytest.mark.long
def test_certificate_of_a_run_despite_an_overdue_instrument_agrees_with_its_log(
    site_folder: SiteFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site_folder.write(ONE_STAGE)
    with_laboratory(site_folder, instruments=[OVERDUE])
    request = replace(site_folder.request(), override_standard="table is at the laboratory")
    site_folder.request = lambda *stages, **more: request  # type: ignore[method-assign,assignment]
    ended = site_folder.run()
    overridden = stated(Path(ended.result_file))["standard_overridden"]
    assert [(each["reason"], each["name"]) for each in overridden] == [("certificate", "rate table")]
    assert run_app(["report", ended.log, "-o", str(tmp_path / "certificate.pdf")]) == 0, capsys.readouterr().err
