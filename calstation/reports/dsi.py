"""Quantities in the D-SI format 2.1.0 of PTB: units, values, expanded uncertainties and covariances.

Source: SI_Format.xsd 2.1.0 (https://ptb.de/si).
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
from lxml import etree
from lxml.builder import ElementMaker
from scipy.special import chdtri

from calstation.judgement import COVERAGE_FACTOR
from calstation.physics import FloatArray

_NAMESPACE = "https://ptb.de/si"
_SI = ElementMaker(namespace=_NAMESPACE, nsmap={"si": _NAMESPACE})

#: Coverage probability of an expanded uncertainty with k = 2, normal distribution.
_PROBABILITY = "0.9545"
#: Coverage probability of the ellipsoidal region.
_REGION_PROBABILITY = 0.95

_NAMES = {"m": "metre", "s": "second", "rad": "radian", "K": "kelvin"}
_POWERS = str.maketrans("⁻²³⁴⁵⁶⁷⁸⁹", "-23456789")


def dsi_unit(*units: str) -> str:
    r"""Return the product of SI units as a D-SI unit: ``rad/s`` is ``\radian\second\tothe{-1}``."""
    powers: Counter[str] = Counter()
    for unit in units:
        numerator, _, denominator = unit.partition("/")
        for part, sign in ((numerator, 1), (denominator, -1)):
            for symbol, power in re.findall(r"([a-zK]+)([⁻²³⁴⁵⁶⁷⁸⁹]*)", part):
                powers[_NAMES[symbol]] += sign * int(power.translate(_POWERS) or 1)
    text = "".join(rf"\{name}" + (rf"\tothe{{{n}}}" if n != 1 else "") for name, n in sorted(powers.items()) if n)
    return text or r"\one"


def real(value: float, unit: str, sigma: float | None = None) -> etree._Element:
    """Return a quantity with its D-SI unit and, if `sigma` is given, its expanded uncertainty.

    Parameters
    ----------
    value : value, SI
    unit : product of SI units, such as ``rad/s``
    sigma : standard uncertainty, SI
    """
    element = _SI("real", _SI("value", _number(value)), _SI("unit", unit))
    if sigma is not None:
        expanded = _SI(
            "expandedUnc",
            _SI("uncertainty", _number(COVERAGE_FACTOR * sigma)),
            _SI("coverageFactor", _number(COVERAGE_FACTOR)),
            _SI("coverageProbability", _PROBABILITY),
            _SI("distribution", "normal"),
        )
        element.append(expanded)
    return element


def real_list(
    names: Sequence[str], units: Sequence[str], values: Iterable[float], sigmas: Iterable[float] = ()
) -> etree._Element:
    """Return quantities as lists with their SI units and, if `sigmas` are given, their expanded uncertainties.

    Parameters
    ----------
    names, units, values, sigmas : one entry per quantity; names without blanks

    Returns
    -------
    etree._Element : an element ``realListXMLList``
    """
    dsi_units = [dsi_unit(unit) for unit in units]
    element = _SI(
        "realListXMLList",
        _SI("labelXMLList", " ".join(names)),
        _SI("valueXMLList", _numbers(values)),
        _SI("unitXMLList", dsi_units[0] if len(set(dsi_units)) == 1 else " ".join(dsi_units)),
    )
    expanded = _numbers(COVERAGE_FACTOR * sigma for sigma in sigmas)
    if expanded:
        uncertainty = _SI(
            "expandedUncXMLList",
            _SI("uncertaintyXMLList", expanded),
            _SI("coverageFactorXMLList", _number(COVERAGE_FACTOR)),
            _SI("coverageProbabilityXMLList", _PROBABILITY),
            _SI("distributionXMLList", "normal"),
        )
        element.append(uncertainty)
    return element


def joint_list(
    names: Sequence[str], units: Sequence[str | Sequence[str]], values: Iterable[float], covariance: FloatArray
) -> etree._Element:
    """Return quantities with their covariance matrix and the coverage factor of the ellipsoidal region.

    They form a ``realList``, because D-SI does not define how rows and list entries correspond in the covariance of an
    ``XMLList``.

    For n quantities that are normally distributed, the square of the factor is the quantile of the chi-squared
    distribution with n degrees of freedom (JCGM 102:2011, 6.5).

    Parameters
    ----------
    names, units, values : one entry per quantity, SI; several units are multiplied
    covariance : covariance matrix, shape (n, n), SI

    Returns
    -------
    etree._Element : an element ``list`` with one ``realList``
    """
    element, factors = _SI("realList"), [(unit,) if isinstance(unit, str) else tuple(unit) for unit in units]
    for name, unit, value in zip(names, factors, values, strict=True):
        quantity = real(value, dsi_unit(*unit))
        quantity.insert(0, _SI("label", name))
        element.append(quantity)
    matrix = _SI("covarianceMatrix")
    for column, unit in zip(covariance.T, factors, strict=True):
        elements = (
            _SI("covariance", _SI("value", _number(value)), _SI("unit", dsi_unit(*row, *unit)))
            for value, row in zip(column, factors, strict=True)
        )
        matrix.append(_SI("column", *elements))
    freedom = int(np.count_nonzero(np.diag(covariance)))  # a fixed quantity does not add a dimension
    factor = math.sqrt(chdtri(freedom, 1.0 - _REGION_PROBABILITY)) if freedom else 1.0
    region = _SI(
        "ellipsoidalRegion",
        matrix,
        _SI("coverageFactor", f"{factor:.4f}"),
        _SI("coverageProbability", str(_REGION_PROBABILITY)),
        _SI("distribution", "normal"),
    )
    element.append(region)
    return _SI("list", element)


def _number(value: float) -> str:
    """Return the text of a number, which is read back unchanged; NaN if it is infinite, which D-SI does not support."""
    return repr(float(value)) if math.isfinite(value) else "NaN"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(_number, values))
