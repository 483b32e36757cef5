"""The digital calibration certificate, an XML document of PTB's schema 3.2.0.

Sources: dcc.xsd 3.2.0 (https://ptb.de/dcc), and the names of `refType` in PTB's good practice examples. All texts are
in English and Chinese, regardless of the language of the report.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import compress, groupby

import numpy as np
from lxml import etree
from lxml.builder import ElementMaker

from calstation import __version__
from calstation.messages import Language, Text, known, parameter_name, render, term
from calstation.physics import INDEX, group_of, pair_name
from calstation.records import InstrumentSection, Verdict, context_from_meta
from calstation.reports.content import Certificate, Quantity, arrangement
from calstation.reports.dsi import dsi_unit, joint_list, real, real_list
from calstation.reports.over_temperature import statement
from calstation.results import TemperatureResult

SCHEMA_VERSION = "3.2.0"
_NAMESPACES = {
    "dcc": "https://ptb.de/dcc",
    "si": "https://ptb.de/si",
    "xsi": "http://www.w3.org/2001/XMLSchema-instance",
}
_DCC = ElementMaker(namespace=_NAMESPACES["dcc"], nsmap=_NAMESPACES)

_LANGUAGES: Mapping[str, Language] = {"en": "en", "zh": "zh_CN"}
#: Standard to which the clauses in statements refer.
_NORM = "ISO/IEC 17025:2017"
#: Type of the result with the coefficients over temperature.
COEFFICIENTS = "calstation_temperatureCoefficients"
#: User-assigned ISO 3166-1 code, used if the station does not specify a country.
_NO_COUNTRY = "ZZ"


def write_dcc(certificate: Certificate, deviations: Iterable[Text] = ()) -> bytes:
    """Return the XML, identical for identical input, of a certificate with `deviations` from the method."""
    root = _DCC(
        "digitalCalibrationCertificate",
        _administrative_data(certificate, deviations),
        _DCC("measurementResults", _measurement_result(certificate)),
        schemaVersion=SCHEMA_VERSION,
    )
    location = f"{_NAMESPACES['dcc']} https://ptb.de/dcc/v{SCHEMA_VERSION}/dcc.xsd"
    root.set(f"{{{_NAMESPACES['xsi']}}}schemaLocation", location)
    etree.indent(root, " ")
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n"


def _administrative_data(certificate: Certificate, deviations: Iterable[Text]) -> etree._Element:
    laboratory = certificate.laboratory
    return _DCC(
        "administrativeData",
        _DCC("dccSoftware", _software(__version__)),
        _core_data(certificate),
        _DCC("items", *_items(certificate)),
        _calibration_laboratory(certificate),
        _DCC("respPersons", *_responsible(certificate)),
        _contact(
            "customer",
            laboratory.customer if laboratory else None,
            laboratory.customer_address if laboratory else None,
        ),
        _DCC("statements", *_statements(certificate), *map(_deviation, deviations)),
    )


def _core_data(certificate: Certificate) -> etree._Element:
    laboratory, log = certificate.laboratory, certificate.result.log
    begin, end = certificate.days
    core = _DCC("coreData", _DCC("countryCodeISO3166_1", (laboratory and laboratory.country) or _NO_COUNTRY))
    core.extend(_DCC("usedLangCodeISO639_1", code) for code in _LANGUAGES)
    core.append(_DCC("mandatoryLangCodeISO639_1", "en"))
    core.append(_DCC("uniqueIdentifier", _token(certificate.identification)))
    identified = {"log": log.sha256, "trail": str(certificate.trail or "")}
    identifications = [_identification("calibrationLaboratory", text, key) for key, text in identified.items() if text]
    if identifications:
        core.append(_DCC("identifications", *identifications))
    if certificate.received is not None:
        core.append(_DCC("receiptDate", certificate.received.isoformat()))
    core.append(_DCC("beginPerformanceDate", begin.isoformat()))
    core.append(_DCC("endPerformanceDate", end.isoformat()))
    core.append(_DCC("performanceLocation", "other" if laboratory and laboratory.place else "laboratory"))
    core.append(_DCC("issueDate", certificate.issued.isoformat()))
    return core


def _items(certificate: Certificate) -> Iterable[etree._Element]:
    product = certificate.meta.product
    model = [_DCC("model", _token(product.name))] if product is not None else []
    serial = _identification("manufacturer", certificate.result.serial, "serial")
    yield _DCC("item", _name("unit"), _unknown_manufacturer(), *model, _DCC("identifications", serial))
    for number, imu in certificate.meta.secondaries.items():
        serial = _identification("manufacturer", imu.serial, "serial")
        name = _name("secondary", number=number)
        yield _DCC("item", name, _unknown_manufacturer(), _DCC("identifications", serial))


def _unknown_manufacturer() -> etree._Element:
    """Return the manufacturer of an item, which the schema requires and the station files do not contain."""
    return _DCC("manufacturer", _name("not_stated"))


def _calibration_laboratory(certificate: Certificate) -> etree._Element:
    laboratory = certificate.laboratory
    if laboratory is None:
        return _DCC("calibrationLaboratory", _contact("contact", certificate.result.station, None))
    code = [_DCC("calibrationLaboratoryCode", _token(laboratory.accreditation))] if laboratory.accreditation else []
    contact = _contact("contact", laboratory.name, laboratory.address, laboratory.country)
    return _DCC("calibrationLaboratory", *code, contact)


def _responsible(certificate: Certificate) -> Iterable[etree._Element]:
    """Yield the issuer and the confirmer of the certificate, the first as main signer, and then the signatories."""
    signatories = certificate.laboratory.signatories if certificate.laboratory else []
    for number, (name, role) in enumerate(zip(certificate.authorised, ("issued", "confirmed"), strict=False)):
        signer = [_DCC("mainSigner", "true")] if number == 0 else []
        yield _person(name, term("dcc", role), *signer)
    for signatory in signatories:
        name, _, role = (part.strip() for part in signatory.partition(","))
        yield _person(name, role)
    if signatories or certificate.authorised:
        return
    if certificate.result.operator:
        yield _person(certificate.result.operator, term("dcc", "operator"))
    else:
        yield _DCC("respPerson", _DCC("person", _name("not_stated")))


def _person(name: str, role: str, *further: etree._Element) -> etree._Element:
    roles = [_DCC("role", role)] if role else []
    return _DCC("respPerson", _DCC("person", _DCC("name", _plain(name))), *roles, *further)


def _statements(certificate: Certificate) -> Iterable[etree._Element]:
    yield _DCC(
        "statement",
        _name("items_only"),
        _DCC("norm", _NORM),
        _DCC("reference", "7.8.2.1 l)"),
        _rich("declaration", "items_only_text"),
    )
    unjudged = certificate.result.unjudged if certificate.verdict is Verdict.PASSED else []
    verdict = "passed_judged" if unjudged else certificate.verdict
    conformity = {"passed": [_DCC("conformity", "pass")], "failed": [_DCC("conformity", "fail")]}
    yield _DCC(
        "statement",
        _name("conformity"),
        _DCC("norm", _NORM),
        _DCC("reference", "7.8.6"),
        _declaration([Text.of(f"dcc.{verdict}", names=unjudged), Text(f"certificate.rule_{certificate.rule}")]),
        *conformity.get(verdict, []),
        refType="basic_conformity",
    )
    if certificate.result.temperature is not None:
        yield _DCC("statement", _name("over_temperature"), _declaration([statement(certificate.result.temperature)]))
    if certificate.supersedes is not None:
        replaced = ". ".join(filter(None, (certificate.supersedes, certificate.reason)))
        yield _DCC("statement", _name("superseded"), _DCC("declaration", _plain(replaced)))
    placement = list(arrangement(certificate.meta))
    if placement:
        yield _DCC("statement", _name("arrangement"), _declaration(placement))
    if certificate.laboratory is not None and certificate.laboratory.place is not None:
        further = _DCC("further", _plain(certificate.laboratory.place))
        yield _DCC("statement", _name("place"), _DCC("location", further))


def _deviation(text: Text) -> etree._Element:
    declared = _declaration([text])
    return _DCC("statement", _name("deviation"), _DCC("norm", _NORM), _DCC("reference", "7.8.2.1 n)"), declared)


def _declaration(texts: Iterable[Text]) -> etree._Element:
    def joined_sentences(language: Language) -> str:
        sentences = (render(text.code, text.values, language, window=True).sentences for text in texts)
        return ("" if language == "zh_CN" else " ").join(sentences)

    return _texts("declaration", joined_sentences)


def _measurement_result(certificate: Certificate) -> etree._Element:
    software = certificate.result.software
    result = _DCC("measurementResult", _name("results"), _DCC("usedMethods", *_methods(certificate)))
    result.append(_DCC("usedSoftware", _software(software.version if software is not None else __version__)))
    if certificate.instruments:
        result.append(_DCC("measuringEquipments", *map(_equipment, certificate.instruments)))
    result.append(_DCC("influenceConditions", *_conditions(certificate)))
    result.append(_DCC("results", *_results(certificate)))
    return result


def _methods(certificate: Certificate) -> Iterable[etree._Element]:
    yield _DCC(
        "usedMethod",
        _name("uncertainty"),
        _rich("description", "uncertainty_text"),
        _DCC("norm", "JCGM 100:2008"),
        _DCC("norm", "JCGM 102:2011"),
        refType="basic_uncertainty",
    )
    for stage in certificate.result.solved_stages:
        name = _texts("name", partial(term, "stage", stage))
        key = ("certificate", f"stage_{stage}")
        description = [_texts("description", partial(term, *key))] if known(".".join(key)) else []
        yield _DCC("usedMethod", name, *description)


def _equipment(instrument: InstrumentSection) -> etree._Element:
    equipment = _DCC("measuringEquipment", _DCC("name", _plain(instrument.name)), refType="basic_normalUsed")
    dates = {"calibrated": instrument.calibrated, "due": instrument.due}
    days = {key: day.isoformat() for key, day in dates.items() if day is not None}
    if days:

        def description(language: Language) -> str:
            return "; ".join(term("dcc", key, language, date=day) for key, day in days.items())

        equipment.append(_texts("description", description))
    identifiers = [("manufacturer", instrument.serial, "serial"), ("other", instrument.certificate, "certificate")]
    identifications = [_identification(issuer, value, key) for issuer, value, key in identifiers if value is not None]
    if identifications:
        equipment.append(_DCC("identifications", *identifications))
    return equipment


def _conditions(certificate: Certificate) -> Iterable[etree._Element]:
    temperature = certificate.temperature
    if temperature is not None:
        rows: tuple[tuple[str, float, dict[str, str]], ...] = (
            ("minimum", temperature.min, {"refType": "basic_temperatureMin"}),
            ("mean", temperature.mean, {}),
            ("maximum", temperature.max, {"refType": "basic_temperatureMax"}),
        )
        quantities = [_DCC("quantity", _name(key), real(value, r"\degreecelsius"), **kind) for key, value, kind in rows]
        name, data = _name("temperature"), _DCC("data", *quantities)
        yield _DCC("influenceCondition", name, data, refType="basic_temperature")
    section, site = certificate.meta.site, context_from_meta(certificate.meta).site
    coordinates = (
        ("latitude", section.latitude_deg, r"\degree"),
        ("longitude", section.longitude_deg, r"\degree"),
        ("height", section.height_m, r"\metre"),
    )
    location = [_DCC("quantity", _name(key), real(value, unit)) for key, value, unit in coordinates]
    yield _DCC("influenceCondition", _name("location"), _DCC("data", *location))
    gravity = real(site.local_gravity, dsi_unit("m/s²"), site.relative_gravity_sigma * site.local_gravity)
    yield _DCC("influenceCondition", _name("gravity"), _DCC("data", _DCC("quantity", _name("gravity"), gravity)))


def _results(certificate: Certificate) -> Iterable[etree._Element]:
    """Yield the values, their joint covariance if the result contains it, and the remaining errors."""
    quantities = certificate.quantities
    groups = [_group(group, rows, _judgement(rows)) for group, rows in _by_group(quantities)]
    yield _DCC("result", _name("parameters"), _DCC("data", *groups))
    correlated = np.array([row.name in INDEX for row in quantities])
    if certificate.result.correlation and correlated.any():
        rows = list(compress(quantities, correlated))
        sigmas = np.array([row.sigma for row in rows])
        covariance = certificate.correlation[np.ix_(correlated, correlated)] * np.outer(sigmas, sigmas)
        joint = _DCC("quantity", joint_list(*_columns(rows), [row.value for row in rows], covariance))
        yield _DCC("result", _name("joint"), _rich("description", "joint_text"), _DCC("data", joint))
    if certificate.result.temperature is not None:
        yield _coefficients(certificate.result.temperature)
    for key, status in (("as_found", "beforeAdjustment"), ("as_left", "afterAdjustment")):
        known_quantities = [q for q in quantities if getattr(q, key) is not None]
        if known_quantities:
            lists = [_group(group, rows, _adjustment(key, status), key) for group, rows in _by_group(known_quantities)]
            yield _DCC("result", _name(key), _rich("description", f"{key}_text"), _DCC("data", *lists))


def _coefficients(over: TemperatureResult) -> etree._Element:
    """Return all coefficients over temperature with their covariance, the reference and the range."""
    names, units, values = [], [], []
    for name, row in over.coefficients.items():
        for power, value in enumerate(row.values):
            names.append(f"{name}[{power}]")
            units.append((row.unit, f"1/K{_power(power)}") if power else (row.unit,))
            values.append(value)
        if row.rate is not None:
            names.append(f"{name}[rate]")
            units.append((row.unit, "s/K"))
            values.append(row.rate.value)
    ends = {"reference": over.reference_c, "minimum": over.range_c[0], "maximum": over.range_c[1]}
    temperatures = [_DCC("quantity", _name(key), real(value, r"\degreecelsius")) for key, value in ends.items()]
    joint = joint_list(names, units, values, np.array(over.covariance))
    data = _DCC("data", *temperatures, _DCC("quantity", joint))
    return _DCC("result", _name("coefficients"), _rich("description", "coefficients_text"), data, refType=COEFFICIENTS)


def _power(power: int) -> str:
    return "" if power == 1 else str(power).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _by_group(quantities: Iterable[Quantity]) -> list[tuple[str, list[Quantity]]]:
    return [(group, list(rows)) for group, rows in groupby(quantities, lambda row: _group_of(row.name))]


def _group_of(name: str) -> str:
    """Return the group of a quantity, with the number of the IMU for the third and further IMUs."""
    number = "".join(filter(str.isdigit, name))
    group = group_of(name)
    return pair_name(group, int(number)) if number else group


def _group(group: str, rows: list[Quantity], further: list[etree._Element], key: str = "value") -> etree._Element:
    """Return the values or the remaining errors (as found, as left) of a group, with their expanded uncertainties."""
    name = _texts("name", partial(parameter_name, group))
    values = real_list(*_columns(rows), [getattr(row, key) for row in rows], [row.sigma for row in rows])
    kind = "basic_measuredValue" if key == "value" else "basic_measurementError"
    quantity = _DCC("quantity", values, *further, refType=kind)
    return _DCC("list", name, quantity)


def _columns(rows: Iterable[Quantity]) -> tuple[list[str], list[str]]:
    """Return the names and the units of quantities as columns."""
    return [row.name for row in rows], [row.unit for row in rows]


def _judgement(rows: list[Quantity]) -> list[etree._Element]:
    """Return the limits and decisions of a group, or an empty list if a quantity was not judged."""
    if any(row.decision == "not_judged" for row in rows):
        return []
    narrowed = [row.accepted for row in rows if row.acceptance is not None and row.accepted is not None]
    limits = {
        ("limit_lower", "basic_toleranceLimitLower"): [row.limit[0] for row in rows if row.limit is not None],
        ("limit_upper", "basic_toleranceLimitUpper"): [row.limit[1] for row in rows if row.limit is not None],
        ("acceptance_lower", "basic_acceptanceLimitLower"): [low for low, _ in narrowed],
        ("acceptance_upper", "basic_acceptanceLimitUpper"): [high for _, high in narrowed],
        ("limit_uncertainty", ""): [row.sigma_limit for row in rows if row.sigma_limit is not None],
    }
    quantities = []
    for (key, kind), values in limits.items():
        if len(values) == len(rows):
            attributes = {"refType": kind} if kind else {}
            quantities.append(_DCC("quantity", _name(key), real_list(*_columns(rows), values), **attributes))
    decided = _DCC("conformityXMLList", " ".join("pass" if row.decision == "passed" else "fail" for row in rows))
    data = [_DCC("data", _DCC("list", *quantities))] if quantities else []
    return [
        _DCC("measurementMetaData", _DCC("metaData", _name("conformity"), decided, *data, refType="basic_conformity"))
    ]


def _adjustment(key: str, status: str) -> list[etree._Element]:
    data = _DCC("data", _rich("text", f"{key}_text"))
    condition = _DCC(
        "influenceCondition", _name("adjustment"), _DCC("status", status), data, refType="basic_adjustment"
    )
    return [_DCC("influenceConditions", condition)]


def _token(text: str) -> str:
    """Return a text without leading and trailing blanks, as the schema requires for identifiers."""
    return text.strip() or "-"


def _plain(text: str) -> etree._Element:
    """Return an element with a text of the site, whose language is unknown."""
    return _DCC("content", text)


def _texts(tag: str, write: Callable[[Language], str]) -> etree._Element:
    """Return an element with a text in each language."""
    return _DCC(tag, *(_DCC("content", write(language), lang=code) for code, language in _LANGUAGES.items()))


def _rich(tag: str, *keys: str) -> etree._Element:
    """Return an element with consecutive sentences of the catalogue."""
    return _texts(tag, lambda lang: ("" if lang == "zh_CN" else " ").join(term("dcc", key, lang) for key in keys))


def _name(key: str, **values: object) -> etree._Element:
    return _texts("name", lambda language: term("dcc", key, language, **values))


def _software(version: str) -> etree._Element:
    return _DCC(
        "software", _DCC("name", _plain("calstation")), _DCC("release", f"v{version}"), _DCC("type", "application")
    )


def _identification(issuer: str, value: str, key: str) -> etree._Element:
    return _DCC("identification", _DCC("issuer", issuer), _DCC("value", _token(value)), _name(key))


def _contact(tag: str, name: str | None, address: str | None, country: str | None = None) -> etree._Element:
    location = _DCC("location", _DCC("further", _plain(address)) if address else _rich("further", "not_stated"))
    if country is not None:
        location.append(_DCC("countryCode", country))
    return _DCC(tag, _DCC("name", _plain(name)) if name else _name("not_stated"), location)
