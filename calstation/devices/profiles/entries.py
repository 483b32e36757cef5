"""Types of entries, and rules for sections, for all profiles."""

from collections.abc import Callable, Iterable, Iterator
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

from pydantic import AfterValidator, Field, model_validator

from calstation.schema import EntryError, StrictModel

LAST_ADDRESS = 0xFFFF

T = TypeVar("T")
M = TypeVar("M", bound=StrictModel)

#: Result of a rule: one or several errors, or a false value if the section obeys the rule.
Errors = EntryError | Iterable[EntryError] | Literal[False] | None
Rule = Callable[[M], Errors]
Rules = tuple[Rule[M], ...]


def as_errors(errors: Errors) -> Iterable[EntryError]:
    """Return the errors in the result of a rule."""
    return [errors] if isinstance(errors, EntryError) else errors or ()


def violations(section: M, rules: Rules[M]) -> Iterator[EntryError]:
    """Yield the errors of a section; only the first is certain, because a rule may assume that earlier rules hold."""
    return (error for rule in rules for error in as_errors(rule(section)))


def check(section: M, rules: Rules[M]) -> M:
    """Return a section if it obeys the rules. Raises EntryError for the first rule that it violates."""
    for error in violations(section, rules):
        raise error
    return section


class ProfileSection(StrictModel):
    """A section of a profile, whose entries must obey `rules`."""

    rules: ClassVar[Rules[Any]] = ()

    @model_validator(mode="after")
    def _check_rules(self) -> Self:
        return check(self, self.rules)


def only_if(applies: Callable[[Any], bool], *rules: Rule[Any]) -> Rules[Any]:
    """Return rules that are checked only for sections for which `applies` is true."""
    return tuple(lambda section, rule=rule: applies(section) and rule(section) for rule in rules)


def each(name: str, *rules: Rule[Any]) -> Rule[Any]:
    """Return a rule that applies the given rules to every element of an entry."""
    return each_item(name, lambda section, key, element: violations(element, rules))


def each_item(name: str, rule: Callable[[Any, Any, Any], Errors]) -> Rule[Any]:
    """Return a rule that calls `rule` with the section, the index or key, and the value of each element of an entry."""

    def of_elements(section: StrictModel) -> Iterator[EntryError]:
        elements = getattr(section, name)
        for key, element in elements.items() if isinstance(elements, dict) else enumerate(elements):
            yield from (with_prefix(error, name, key) for error in as_errors(rule(section, key, element)))

    return of_elements


def needs(owner: str, *names: str) -> Rule[Any]:
    """Return a rule that requires these entries; the section is inserted into `owner`, which requires them."""
    return lambda section: (
        EntryError("profile.needed_by", name, owner=owner.format(section))
        for name in names
        if not is_set(section, name)
    )


def excludes(other: str, *names: str) -> Rule[Any]:
    """Return a rule that forbids these entries together with `other`, into which the section is inserted."""
    return lambda section: (
        EntryError("profile.not_with", name, other=other.format(section)) for name in names if is_set(section, name)
    )


def only_with(owner: str, *names: str) -> Rule[Any]:
    """Return a rule that forbids these entries, because they belong to `owner`."""
    return lambda section: (
        EntryError("profile.belongs_to", name, owner=owner) for name in names if is_set(section, name)
    )


def is_set(section: StrictModel, name: str) -> bool:
    """Return whether an entry differs from its default."""
    default = type(section).model_fields[name].get_default(call_default_factory=True)
    return bool(getattr(section, name) != default)


def with_prefix(error: EntryError, *prefix: str | int) -> EntryError:
    """Return an error with `prefix`, the key path of its section, prepended to its own key path."""
    return EntryError(error.code, *prefix, *error.key_path, **error.values)


def require(value: T, is_valid: object, code: str, **values: Any) -> T:
    """Return `value` if it is valid; otherwise raise EntryError with the code and the other values."""
    if not is_valid:
        raise EntryError(code, value=value, **values)
    return value


def one_of(kinds: Iterable[str]) -> AfterValidator:
    """Return a validator that accepts only the checksum names in `kinds`."""
    names = list(kinds)
    return AfterValidator(lambda kind: require(kind, kind in names, "profile.unknown_check", names=names))


def hex_bytes(text: str) -> bytes:
    """Convert hexadecimal text, e.g. "55 AA", to bytes. Raises EntryError."""
    try:
        return bytes.fromhex(text)
    except ValueError:
        raise EntryError("profile.not_hexadecimal", value=text) from None


def _check_range(ends: tuple[float, float]) -> tuple[float, float]:
    return require(ends, ends[0] < ends[1], "profile.range_order", low=ends[0], high=ends[1])


def _check_hexadecimal(text: str) -> str:
    hex_bytes(text)
    return text


#: Address of a 16-bit register or a register entry, 0-based.
Address = Annotated[int, Field(ge=0, le=LAST_ADDRESS)]

#: The content of a 16-bit register.
Word = Annotated[int, Field(ge=0, le=0xFFFF)]

#: Bytes in hexadecimal.
HexText = Annotated[str, AfterValidator(_check_hexadecimal)]

#: One or more bytes in hexadecimal.
SyncText = Annotated[str, AfterValidator(lambda text: require(text, hex_bytes(text), "profile.no_sync_bytes"))]

#: Lowest and highest temperature, °C.
TemperatureRange = Annotated[tuple[float, float], Field(strict=False), AfterValidator(_check_range)]

#: A factor other than 0.
Scale = Annotated[float, AfterValidator(lambda scale: require(scale, scale != 0.0, "profile.scale_zero"))]

#: Text that the model name reported by a device must contain.
ModelName = Annotated[
    str, Field(min_length=1), AfterValidator(lambda model: require(model, model.strip(), "profile.model_blank"))
]


def _check_command_line(line: str) -> str:
    is_plain = line and line.isascii() and line.isprintable() and not set(line) & set("$*")
    return require(line, is_plain, "profile.not_a_command_line")


#: A command line of a VectorNav without $ and checksum.
CommandLine = Annotated[str, AfterValidator(_check_command_line)]


class SerialSettings(StrictModel):
    """Settings of a serial port; `write_timeout_s` is the timeout for sending a command, host time in s."""

    baud: int = Field(default=115200, ge=50, le=12_000_000)
    data_bits: Literal[5, 6, 7, 8] = 8
    parity: Literal["N", "E", "O", "M", "S"] = "N"
    stop_bits: Annotated[
        float, AfterValidator(lambda bits: require(bits, bits in (1, 1.5, 2), "profile.stop_bits"))
    ] = 1
    write_timeout_s: float = Field(default=1.0, gt=0, le=60)

    @property
    def line(self) -> str:
        """The settings in the usual notation, e.g. ``921600 8N1``."""
        return f"{self.baud} {self.data_bits}{self.parity}{self.stop_bits:g}"

    @property
    def bits_per_byte(self) -> float:
        """Number of bits on the line per byte, including start, parity and stop bits."""
        return 1 + self.data_bits + (self.parity != "N") + self.stop_bits
