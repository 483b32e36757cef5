"""Read a digital calibration certificate as a customer's program does, and validate it by PTB's schema and rules."""

import os
import socket
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree

from calstation.physics import FloatArray

NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
#: Folder with `dcc.xsd` 3.2.0 and what it imports, for computers without access to ptb.de.
SCHEMAS = "CALSTATION_DCC_SCHEMAS"


@dataclass(frozen=True)
class Reading:
    """The quantities of a certificate."""

    values: dict[str, float]
    units: dict[str, str]  #: D-SI units.
    expanded: dict[str, float]  #: Expanded uncertainties.
    as_found: dict[str, float]
    as_left: dict[str, float]
    decisions: dict[str, str]  #: ``pass`` or ``fail``.
    names: list[str]  #: Order of the covariance matrix; empty without one.
    covariance: FloatArray


def read_dcc(xml: bytes) -> Reading:
    """Read the quantities of a certificate."""
    root = etree.fromstring(xml)
    parameters, *others = find(root, "//dcc:result")
    remaining = {status(result): result for result in others if find(result, ".//dcc:status")}
    columns = find(root, "//dcc:result[not(@refType)]//si:column")
    return Reading(
        values=listed(parameters, "si:valueXMLList"),
        units=labelled(parameters, "si:unitXMLList"),
        expanded=listed(parameters, ".//si:uncertaintyXMLList"),
        as_found=listed(remaining.get("beforeAdjustment"), "si:valueXMLList"),
        as_left=listed(remaining.get("afterAdjustment"), "si:valueXMLList"),
        decisions=labelled(parameters, "../dcc:measurementMetaData//dcc:conformityXMLList"),
        names=[label.text for label in find(root, "//dcc:result[not(@refType)]//si:label")],
        covariance=matrix(columns),
    )


@dataclass(frozen=True)
class Coefficients:
    """The coefficients over temperature of a certificate."""

    temperatures: list[float]  #: Reference, lowest and highest temperature, °C.
    values: dict[str, float]
    units: dict[str, str]  #: D-SI units.
    covariance: FloatArray

    def parameter(self, name: str, temperature: float) -> tuple[float, float]:
        """Return a parameter at a temperature, °C, and its standard uncertainty."""
        factors = np.zeros(len(self.values))
        for k, label in enumerate(self.values):
            parameter, _, power = label.rstrip("]").partition("[")
            if parameter == name and power != "rate":
                factors[k] = (temperature - self.temperatures[0]) ** int(power)
        value = float(factors @ np.array(list(self.values.values())))
        return value, float(np.sqrt(factors @ self.covariance @ factors))


def read_coefficients(xml: bytes) -> Coefficients:
    """Read the coefficients over temperature."""
    (result,) = find(etree.fromstring(xml), "//dcc:result[@refType='calstation_temperatureCoefficients']")
    reals = find(result, ".//si:realList/si:real")
    labels = [find(each, "si:label")[0].text for each in reals]
    return Coefficients(
        [float(each.text) for each in find(result, "dcc:data/dcc:quantity/si:real/si:value")],
        {label: float(find(each, "si:value")[0].text) for label, each in zip(labels, reals, strict=True)},
        {label: find(each, "si:unit")[0].text for label, each in zip(labels, reals, strict=True)},
        matrix(find(result, ".//si:column")),
    )


def matrix(columns: list[Any]) -> FloatArray:
    """Return the covariance matrix with these columns."""
    return np.array([[float(v.text) for v in find(column, "si:covariance/si:value")] for column in columns]).T


def find(element: etree._Element, path: str) -> list[Any]:
    """Return the elements of an XPath."""
    found = element.xpath(path, namespaces=NAMES)
    assert isinstance(found, list)
    return found


def status(result: etree._Element) -> str:
    """Return whether a result is before or after the adjustment."""
    (one,) = {element.text for element in find(result, ".//dcc:influenceCondition/dcc:status")}
    return str(one)


def labelled(result: etree._Element | None, path: str) -> dict[str, str]:
    """Return the list entries of a result by label; a list with one entry applies to all labels."""
    found: dict[str, str] = {}
    for group in [] if result is None else find(result, "dcc:data/dcc:list/dcc:quantity/si:realListXMLList"):
        (labels,) = find(group, "si:labelXMLList")
        entries = [text for element in find(group, path) for text in element.text.split()]
        entries *= len(labels.text.split()) if len(entries) == 1 else 1
        found |= dict(zip(labels.text.split(), entries, strict=bool(entries)))
    return found


def listed(result: etree._Element | None, path: str) -> dict[str, float]:
    """Return the numbers of the lists of a result by label."""
    return {label: float(text) for label, text in labelled(result, path).items()}


@cache
def schema() -> etree.XMLSchema:
    """Return PTB's schema from the folder named by the environment, or downloaded once to the user's cache."""
    from dcc_json_toolkit.cache import CACHE_DIR_PATH
    from dcclib.validation.xsd import get_schema_path

    if SCHEMAS in os.environ:
        return etree.XMLSchema(etree.parse(Path(os.environ[SCHEMAS]) / "dcc.xsd"))
    if not (CACHE_DIR_PATH / "3.2.0" / "dcc.xsd").exists():
        try:
            socket.create_connection(("ptb.de", 443), timeout=10.0).close()
        except OSError:
            pytest.skip(
                f"the schema of the DCC cannot be downloaded from ptb.de, and {SCHEMAS} names no folder with it"
            )
    return etree.XMLSchema(etree.parse(get_schema_path("3.2.0")))


def broken_rules(xml: bytes) -> list[str]:
    """Return the violated PTB Schematron rules, which are included in its library."""
    from dcclib.validation import SchematronValidator

    found = SchematronValidator.for_dcc().validate_str(xml.decode())
    reports = [*found.failed_assertions, *found.successful_reports]
    return [f"{report.location}: {report.text}" for report in reports if report.role == "error"]
