"""Labels for units that passed, from a ZPL template for a label printer or from a Typst template for a PDF."""

import hashlib
import io
import socket
import string
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from calstation.config import Confirmation, library, load_product, load_station, site_folder
from calstation.devices.links import host_and_port
from calstation.errors import CalstationError, ConfigurationError, DeviceFaultError, InputError
from calstation.escaping import for_zpl
from calstation.jobs import ProgressCallback
from calstation.messages import Text, local_time, os_reason
from calstation.records import IssuedReport, Verdict, audit_writer, issued_reports, open_log, write_atomic
from calstation.registers import run_registers
from calstation.reports.content import certificate_number
from calstation.reports.pdf import compile_template
from calstation.results import History, Result, find_log, load_result, load_run_result, was_simulated

#: Timeout for connecting to a printer and for sending a label, host time, s.
_TIMEOUT_S = 5.0


def label_template(result: Result) -> Path | None:
    """Return the label template of the product of a result, or None if the unit must have no label.

    A label is printed only if a run of all stages passed. Raises ConfigurationError if the product cannot be
    read.
    """
    return product_label(result) if result.verdict is Verdict.PASSED else None


def product_label(result: Result) -> Path | None:
    """Return the label template of the product of a result, whatever its verdict, or None if the product has none.

    Raises ConfigurationError if the product cannot be read.
    """
    source = result.configuration.get("product")
    if source is None or source.name not in library.names("products"):
        return None
    path, product = load_product(library.find("products", source.name))
    return None if product.label is None else library.find_beside(path, product.label)


def print_label(
    report: ProgressCallback, result_file: Path, station: Path | None, author: Confirmation | None = None
) -> Path | None:
    """Job: print the label of a run or, for a Typst template, return a PDF file in ``labels`` next to the runs.

    The audit trail records the label after it has been sent to the printer or its PDF has been written.

    Parameters
    ----------
    report : callback for the progress
    result_file : result of the run
    station : station file with the printer; None for the default
    author : person who prints the label; None for the program

    Raises
    ------
    InputError : if the run has no label or the template cannot be filled in.
    ConfigurationError : if the station has no printer, or the audit trail was changed or cannot be written.
    DeviceFaultError : if the printer cannot be reached.
    """
    result = load_run_result(result_file, require_log=True)
    result = result.model_copy(update={"simulated": was_simulated(result, result_file)})
    template = label_template(result)
    if template is None:
        raise InputError("label.not_passed", serial=result.serial)
    history = History(result_file.parent, measured=not result.simulated)
    history.refresh()
    failed = history.failed_after(result.serial, result.started_utc or "")
    if failed is not None:
        raise InputError("label.failed_later", serial=result.serial, when=local_time(failed.started_utc))
    log = find_log(result, result_file)
    if log is not None and result.log.sha256 and open_log(log).facts().sha256 != result.log.sha256:
        raise InputError("label.log_changed", serial=result.serial, log=log)
    if {*result.not_compared} - {*result.unobservable}:  # estimated neither by a stage nor before
        raise InputError("label.not_judged", serial=result.serial, names=result.unjudged)

    def recorded(send: Callable[[], object], **values: Any) -> None:
        people = author or Confirmation("")
        simulated = {"simulated": True} if result.simulated else {}
        values = {"serial": result.serial, "run": certificate_number(result), **simulated, **values, "pin": people.pin}
        with audit_writer(site_folder()) as audit:
            audit.require_intact()
            send()
            audit.append_event("label_printed", people.by, **values)

    if template.suffix == ".zpl":
        _print_text(_fill_template(template, label_fields(result, result_file.parent)), station, recorded)
        return None
    pdf = result_file.absolute().parent.parent / "labels" / f"{result_file.stem}.pdf"
    content = _compile_pdf(template, result, label_fields(result, result_file.parent))
    recorded(lambda: _write(pdf, content), file=pdf.name, sha256=hashlib.sha256(content).hexdigest())
    return pdf


@dataclass(frozen=True)
class PrintedLabels:
    """PDF files of labels, reasons why the labels of other results were not printed, and cautions."""

    pdfs: list[Path]
    errors: dict[Path, Text] = field(default_factory=dict)
    cautions: list[Text] = field(default_factory=list)  #: Warnings about labels that were printed.


def print_labels(
    report: ProgressCallback, result_files: Sequence[Path], station: Path | None, author: Confirmation | None = None
) -> PrintedLabels:
    """Job: print the labels of several runs, up to an error of the printer; see `print_label`."""
    printed = PrintedLabels([])
    for number, result_file in enumerate(result_files):
        report(number / len(result_files))
        try:
            caution = _replaced_registers(load_result(result_file), result_file.parent)
            pdf = print_label(report, result_file, station, author)
        except InputError as error:
            printed.errors[result_file] = error.as_text
        except CalstationError as error:
            printed.errors.update(dict.fromkeys(result_files[number:], error.as_text))
            break
        else:
            printed.pdfs.extend([] if pdf is None else [pdf])
            printed.cautions.extend([] if caution is None else [caution])
    return printed


def _replaced_registers(result: Result, runs: Path) -> Text | None:
    """Return a caution if the unit no longer contains the registers of a run, or if this is unknown; else None."""
    try:
        registers = run_registers(result, runs)
    except ConfigurationError as error:
        return error.as_text
    if registers is None or registers.later is None:
        return None
    return Text.of("label.registers_replaced", serial=result.serial, time=registers.later.utc)


def label_fields(result: Result, folder: Path | None = None) -> dict[str, str]:
    """Return the texts for the fields of a template; ``code`` is the content of the two-dimensional code.

    ``certificate`` is the last revision that is recorded in `folder`, the folder of the runs, or empty.
    """
    run, issued = certificate_number(result), list[IssuedReport]()
    if folder is not None:
        with suppress(InputError):  # a damaged record confirms no certificate
            issued = issued_reports(folder, (), run)
    date, _, time = local_time(result.started_utc or "").partition(" ")
    zone = local_time(result.started_utc or "", zone=True).rpartition(" ")[2]
    return {
        "serial": result.serial,
        "product": result.product or "",
        "station": result.station or "",
        "operator": result.operator or "",
        "verdict": "SIMULATED" if result.simulated else "PASS",
        "date": date,
        "time": time,
        "zone": zone,
        "attempt": str(result.attempt),
        "software": result.software.version if result.software is not None else "",
        "run": run,
        "certificate": issued[-1].identification if issued else "",
        "code": f"{result.serial} {run}",
    }


def qr_code(text: str) -> str:
    """Return the QR code of a text as an SVG image, with the quiet zone."""
    import segno

    image = io.BytesIO()
    segno.make_qr(text, error="m").save(image, kind="svg", xmldecl=False)
    return image.getvalue().decode()


def _fill_template(template: Path, texts: Mapping[str, str]) -> str:
    fields = {name: for_zpl(text) for name, text in texts.items()}
    try:
        return string.Template(template.read_text(encoding="utf-8")).substitute(fields)
    except OSError as exc:
        raise InputError("entry.unreadable", file=template, reason=os_reason(exc)) from exc
    except KeyError as exc:
        raise InputError("label.unknown_field", file=template, name=exc.args[0], known=list(fields)) from exc
    except ValueError as exc:  # the template has a single dollar sign or is not UTF-8
        raise InputError("label.not_a_template", file=template, detail=str(exc)) from exc


def _write(pdf: Path, content: bytes) -> None:
    try:
        pdf.parent.mkdir(exist_ok=True)
        write_atomic(pdf, content)
    except OSError as exc:
        raise InputError("label.unwritable", file=pdf, reason=os_reason(exc)) from exc


def _print_text(text: str, station: Path | None, recorded: Callable[..., None]) -> None:
    """Send a text to the printer of the station with `recorded`, which also receives the address of the printer."""
    path, config = load_station(station)
    address = None if config.label is None else host_and_port(config.label.printer)
    if config.label is None or address is None:
        raise ConfigurationError("label.no_printer", station=path)
    printer = config.label.printer
    try:
        with socket.create_connection(address, timeout=_TIMEOUT_S) as connection:
            recorded(lambda: _send(connection, text, printer), printer=printer)
    except OSError as exc:
        raise DeviceFaultError("label.printer_unreachable", printer=printer, reason=os_reason(exc)) from exc


def _send(connection: socket.socket, text: str, printer: str) -> None:
    try:
        connection.sendall(text.encode())
    except OSError as exc:  # is not an error of the audit trail
        raise DeviceFaultError("label.printer_unreachable", printer=printer, reason=os_reason(exc)) from exc


def _compile_pdf(template: Path, result: Result, texts: Mapping[str, str]) -> bytes:
    """Return the PDF of a template, identical for identical results."""
    from typst import TypstError

    started = (
        datetime.fromisoformat(result.started_utc) if result.started_utc else datetime.fromtimestamp(0).astimezone()
    )
    fields = {**texts, "qr": qr_code(texts["code"])}
    try:
        return compile_template(template, fields, started, template.parent)
    except TypstError as exc:
        names = list(fields)
        raise InputError("label.typst", file=template, detail=exc.message, known=names) from exc
