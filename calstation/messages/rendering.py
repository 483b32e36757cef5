"""Messages as data, and their rendering in one language."""

import errno
import re
import string
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from calstation.escaping import for_sentence
from calstation.messages.catalogue import entry, known

Language = Literal["en", "zh_CN"]

#: A message's values: JSON data, or another message that becomes part of the sentence.
Value = Any

#: Values that the command line adds so that the commands in remedies can be copied unchanged: the options that select
#: station and product, the run folder and the slot. Otherwise, and in the window, they are empty.
COMMAND_OPTIONS = ("station_options", "out_option", "slot_option")

#: Remedy that operators see instead of one for engineers.
_ASK = "advice.ask_about_device"

#: Largest numbers of characters of a value and of a list in a sentence.
_MAX_VALUE, _MAX_LIST = 500, 1500

#: Endings of complete sentences.
_ENDS = (".", "?", "!", ".)", "。", "？", "！", "。）")

#: Directions of axes, such as ``-x`` and ``+x-y``, whose hyphens are minus signs.
_AXES = re.compile(r"([+-][xyz])+")

#: Smallest difference of a probability from 0 or 1 with which the probability is shown as a number.
_SMALLEST_SHARE = 1e-4
#: Smallest number that is shown with an exponent.
_MIN_WITH_EXPONENT = 1e6

_NO_DIGITS = str.maketrans("", "", string.digits)

_OS_REASONS = {
    errno.ENOENT: "os.not_found",
    errno.EACCES: "os.no_permission",
    errno.EPERM: "os.no_permission",
    errno.ENOSPC: "os.disk_full",
    errno.EDQUOT: "os.disk_full",
    errno.EFBIG: "os.file_limit",
    errno.EROFS: "os.read_only",
    errno.EBUSY: "os.busy",
    errno.EEXIST: "os.exists",
    errno.EISDIR: "os.is_folder",
    errno.ENOTDIR: "os.not_folder",
    errno.ESPIPE: "os.not_a_file",
    errno.ENOLCK: "os.no_locks",
    errno.EIO: "os.io_error",
    errno.ENODEV: "os.no_device",
    errno.ENXIO: "os.no_device",
    errno.ECONNREFUSED: "os.connection_refused",
    errno.ECONNRESET: "os.connection_lost",
    errno.EPIPE: "os.connection_lost",
    errno.EHOSTUNREACH: "os.unreachable",
    errno.ENETUNREACH: "os.unreachable",
    errno.ETIMEDOUT: "os.timed_out",
    errno.ENAMETOOLONG: "os.name_too_long",
}


@dataclass(frozen=True)
class Text:
    """A catalogue code with its values; may itself be a value of another message."""

    code: str
    values: Mapping[str, Value] = field(default_factory=dict)

    @classmethod
    def of(cls, code: str, **values: Value) -> "Text":
        """Create the message of a code with these values."""
        return cls(code, values)

    def __str__(self) -> str:
        return sentence(self)

    def to_json(self) -> dict[str, Any]:
        """Return code and values as JSON data; nested messages are converted likewise."""
        return {"code": self.code, "values": values_to_json(self.values)}


@dataclass(frozen=True)
class Rendered:
    """A message in one language: location of the cause or "", what happened, and the remedy or ""."""

    source: str
    text: str
    remedy: str
    language: Language = "en"

    @property
    def sentences(self) -> str:
        """What happened and what to do."""
        return joined(self.text, self.remedy, self.language)

    @property
    def line(self) -> str:
        """The whole message on one line, starting with its source."""
        return f"{self.source}: {self.sentences}" if self.source else self.sentences


def render(
    code: str, values: Mapping[str, Value], language: Language = "en", *, window: bool = False, operator: bool = False
) -> Rendered:
    """Render a message in one language. Raises KeyError for an unknown code or a missing value.

    With `window`, remedies may refer to elements of the window, such as buttons; in Chinese they always do. With
    `operator`, texts with ports and files, and remedies for engineers, are replaced.
    """
    message = entry(code)
    options = {name: values[name] for name in COMMAND_OPTIONS if name in values}
    form = _Formatter(language, window, operator, options)
    source = term("source", message.source.format(**values), language) if message.source else ""
    if language == "zh_CN" and message.zh:
        text, remedy = message.zh, message.zh_remedy
    else:
        text, remedy = message.text, message.window if window and message.window else message.remedy
    if operator and message.operator:
        text = message.operator[language == "zh_CN"]
    if operator and message.engineer:
        remedy = render(_ASK, {}, language).text
    return Rendered(source, form.vformat(text, (), values), form.vformat(remedy, (), values), language)


def sentence(message: Text, language: Language = "en", *, window: bool = False) -> str:
    """Render a message on one line."""
    return render(message.code, message.values, language, window=window).line


def joined(text: str, remedy: str, language: Language) -> str:
    """Join a text and its remedy, with a full stop between them if the text does not end with one."""
    if not remedy:
        return text
    stop = "" if text.endswith(_ENDS) else "。" if language == "zh_CN" else "."
    return f"{text}{stop}{'' if language == 'zh_CN' else ' '}{remedy}"


def term(family: str, name: str, language: Language = "en", **values: Value) -> str:
    """Return a term of a family, such as the stage ``rate``; underscores in an unknown name become spaces."""
    code = f"{family}.{name}"
    return render(code, values, language).text if known(code) else str(name).replace("_", " ")


def event_text(event_id: str, values: Mapping[str, Value]) -> Text:
    """Return the message of a progress event; an unknown id is shown with its values."""
    code = f"event.{event_id}"
    if known(code):
        return Text(code, values)
    details = ", ".join(f"{name} {value}" for name, value in values.items())
    return Text.of("event.other", words=f"{event_id.replace('_', ' ')}{': ' if details else ''}{details}")


def step_text(kind: str, label: tuple[str | float, ...]) -> Text:
    """Return the description of a step from its kind (``move``, ``dwell``, ``carry``) and the label set by its plan."""
    if kind == "dwell":
        return Text("step.dwell")
    if not label:
        return Text("step.move")
    if known(f"step.{label[0]}"):
        return _labelled("step", label)
    words = " ".join(f"{part:g}" if isinstance(part, float | int) else part.replace("_", " ") for part in label)
    return Text.of("step.other", words=words)


def short_step_text(label: tuple[str | float, ...]) -> Text:
    """Return a short description of a move from its label, or else the result of `step_text`."""
    return _labelled("step_short", label) if known(f"step_short.{label[0]}") else step_text("move", label)


def _labelled(family: str, label: tuple[str | float, ...]) -> Text:
    name, *parts = label
    values = [part.replace("-", "−") if isinstance(part, str) and _AXES.fullmatch(part) else part for part in parts]
    return Text(f"{family}.{name}", dict(zip(entry(f"step.{name}").values, values, strict=False)))


def local_time(utc: str, *, zone: bool = False) -> str:
    """Format an ISO 8601 time in this computer's time zone, to the minute; any other text is unchanged.

    With `zone`, add seconds and the time zone with its offset, unless that is 0: ``2026-11-22 15:30:05 UTC+08:00``.
    """
    try:
        local = datetime.fromisoformat(utc).astimezone()
    except ValueError:
        return utc
    if not zone:
        return f"{local:%Y-%m-%d %H:%M}"
    return f"{local:%Y-%m-%d %H:%M:%S} UTC{local.isoformat()[-6:]}".removesuffix("+00:00")


def parameter_name(name: str, language: Language = "en") -> str:
    """Return the display name of a group or a parameter (group and axis, and the IMU if there are several)."""
    imu = "".join(filter(str.isdigit, name))
    plain = name.translate(_NO_DIGITS)
    group, _, axes = (plain, "", "") if known(f"group.{plain}") else plain.rpartition("_")
    text = f"{term('group', group, language)} {axes}".strip()
    return f"{text}, IMU {imu}" if imu else text


def product_name(name: str, language: Language = "en") -> str:
    """Return the display name of a product from the name in its file; the names of shipped products are translated."""
    code = f"product_name.{_key(name)}"
    return render(code, {}, language).text if known(code) else name


def station_name(name: str, language: Language = "en") -> str:
    """Return the display name of a station from the name in its file; the names of shipped stations are translated."""
    code = f"station_name.{_key(name)}"
    return render(code, {}, language).text if known(code) else name


def _key(name: str) -> str:
    """Return a name in lower case, with `_` for all characters other than letters and digits."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower())


def schedule_name(name: str, language: Language = "en", *, stage: str = "") -> str:
    """Return the display name of an entry of a stage's schedule, derived from its identifier if it has no term."""
    for code in (f"{stage}_{name}", name):
        if known(f"schedule.{code}"):
            return term("schedule", code, language)
    return name.rsplit("_", 1)[0].replace("_", " ").capitalize()


def rounds_text(stage: str, rounds: int) -> Text:
    """Return a number of rounds of a stage in the unit that its schedule counts, such as 12 rounds or 12 moves."""
    own = f"schedule.counted_{stage}"
    return Text.of(own if known(own) else "schedule.counted", count=rounds)


def plain_number(value: float, form: str) -> str:
    """Format a number; a large one has no exponent, such as 1234 instead of 1.23e+03 for the format ``.3g``."""
    text = format(value, form)
    if "e+" not in text or abs(value) >= _MIN_WITH_EXPONENT:
        return text
    return format(value, "+.0f" if form.startswith("+") else ".0f")


def with_minus(text: str) -> str:
    """Return the text of a number with a minus sign, U+2212, instead of the hyphen."""
    return text.replace("-", "−")


def os_reason(error: OSError) -> Text:
    """Return the reason for an operating-system error as a translatable message."""
    if isinstance(error, TimeoutError):
        return Text("os.timed_out")
    if error.errno is None:
        return Text.of("os.other", words=str(error))
    code = _OS_REASONS.get(error.errno)
    return Text(code) if code else Text.of("os.number", number=error.errno, words=error.strerror)


def values_to_json(values: Mapping[str, Value]) -> dict[str, Any]:
    """Convert the values of a message to JSON: paths to text, NumPy scalars to numbers, messages to objects."""
    return {name: _to_json(value) for name, value in values.items()}


def values_from_json(values: Mapping[str, Any]) -> dict[str, Value]:
    """Restore values written by `values_to_json`, including nested messages."""
    return {name: _from_json(value) for name, value in values.items()}


#: Functions that return the display name of a value, by the format of a placeholder.
_NAMES = {"parameter": parameter_name, "product": product_name, "station": station_name}


class _Formatter(string.Formatter):
    """A `str.format` that also renders nested messages, the terms of a family (``{axis:@joint}``), times and names.

    ``{utc:local_time}`` shows a UTC time in this computer's time zone. ``{name:parameter}``, ``{name:product}`` and
    ``{name:station}`` show the display name in the window, otherwise the name in files. In the window, times have no
    seconds and no zone. ``{count:# run}`` shows a number with an English noun, which is in the singular after 1.
    ``{probability:percent}`` shows a probability from 0 to 1 in percent, or that it is close to 0 or 1.
    """

    def __init__(self, language: Language, window: bool, operator: bool, options: Mapping[str, Value]) -> None:
        self._language: Language = language
        self._window, self._operator = window, operator
        self._options = options

    def get_value(self, key: int | str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> Any:
        if key in COMMAND_OPTIONS:
            return self._options.get(str(key), "")
        return super().get_value(key, args, kwargs)

    def format_field(self, value: Any, format_spec: str) -> str:
        text = self._formatted(value, format_spec)
        if isinstance(value, Text):
            return text
        limit = _MAX_LIST if isinstance(value, list | tuple) else _MAX_VALUE
        return for_sentence(text if len(text) <= limit else text[:limit] + "…")

    def _formatted(self, value: Any, format_spec: str) -> str:
        if isinstance(value, Text):
            values = {**value.values, **self._options}
            text = render(value.code, values, self._language, window=self._window, operator=self._operator)
            return text.remedy if format_spec == "remedy" else text.text
        if isinstance(value, list | tuple):
            separator = "、" if self._language == "zh_CN" else ", "
            return separator.join(self.format_field(item, format_spec) for item in value) or "–"
        if format_spec in ("local_time", "zoned_time"):
            return local_time(str(value), zone=format_spec == "zoned_time" or not self._window)
        if format_spec in _NAMES:
            return _NAMES[format_spec](str(value), self._language) if self._window else str(value)
        if format_spec.startswith("@"):
            return term(format_spec[1:], str(value), self._language)
        if value is None:
            return "–"
        if format_spec.startswith("# "):
            count = plain_number(value, ".12g") if isinstance(value, float) else str(value)
            return f"{count} {format_spec[2:] if count == '1' else _plural(format_spec[2:])}"
        if format_spec == "percent":
            return self._percent(value)
        number = isinstance(value, float) and format_spec.endswith("g")
        text_of_value = plain_number(value, format_spec) if number else str(super().format_field(value, format_spec))
        return with_minus(text_of_value) if self._window and isinstance(value, float | int) else text_of_value

    def _percent(self, probability: float) -> str:
        if probability < _SMALLEST_SHARE:
            return sentence(Text("common.percent_below"), self._language)
        if probability > 1.0 - _SMALLEST_SHARE:
            return sentence(Text("common.percent_above"), self._language)
        return f"{plain_number(100.0 * probability, '.2g')} %"


def _plural(noun: str) -> str:
    if noun.endswith("y") and noun[-2] not in "aeiou":
        return f"{noun[:-1]}ies"
    return f"{noun}es" if noun.endswith("s") else f"{noun}s"


def _to_json(value: Value) -> Any:
    if isinstance(value, Text):
        return value.to_json()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return values_to_json(value)
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [_to_json(item) for item in value]
    return value.item() if hasattr(value, "item") else value


def _from_json(value: Any) -> Value:
    if isinstance(value, dict) and set(value) == {"code", "values"}:
        return Text(value["code"], values_from_json(value["values"]))
    if isinstance(value, list):
        return [_from_json(item) for item in value]
    return value
