"""Faults in the language in force: where their cause is, what is wrong, and the mend.

The engine's errors are English sentences ``cause: what is wrong; the mend``, as its command line shows them. Here
each sentence of a run is known by its pattern, so that it can be said again in another language; one that is not
known is shown as it is.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

from PySide6.QtCore import QCoreApplication

from calstation.config.request import OR_AT_REST
from calstation.gui.text.fault_phrases import PHRASES
from calstation.gui.text.fault_sentences import SENTENCES
from calstation.messages.marked import QT_TRANSLATE_NOOP

_CAUSES = {
    "table": QT_TRANSLATE_NOOP("faults", "Table"),
    "imu": QT_TRANSLATE_NOOP("faults", "IMU"),
    "bench": QT_TRANSLATE_NOOP("faults", "Virtual bench"),
    "engine": QT_TRANSLATE_NOOP("faults", "Program"),
    "configuration": QT_TRANSLATE_NOOP("faults", "Configuration"),
    "data": QT_TRANSLATE_NOOP("faults", "Data"),
}


#: Names of a proof's comparisons (`station.proof`), in words.
_MEASURED = {
    "gravity": QT_TRANSLATE_NOOP("faults", "gravity"),
    "earth_rate": QT_TRANSLATE_NOOP("faults", "the earth's rate"),
    "earth_rate_up": QT_TRANSLATE_NOOP("faults", "the earth's rate about the vertical"),
    "outer_turn": QT_TRANSLATE_NOOP("faults", "the turn of the outer axis"),
    "inner_turn": QT_TRANSLATE_NOOP("faults", "the turn of the inner axis"),
    "carried_turn": QT_TRANSLATE_NOOP("faults", "gravity carried along by the gyros"),
    "force_difference": QT_TRANSLATE_NOOP("faults", "the force at rest is off by"),
    "rate_difference": QT_TRANSLATE_NOOP("faults", "the rate at rest is off by"),
    "turn_difference": QT_TRANSLATE_NOOP("faults", "a turn is off by"),
}

_HEADS = ("table: ", "IMU: ", "engine: ", "virtual bench: ")
_ENGINE_DEAD = "engine: its process ended unexpectedly"
_HEAD = re.compile(r"^[^:：]*(: |：)")


#: Sentences that a window says otherwise than a terminal: in plainer words, or with a mend that is a button.
_REWORDED: tuple[tuple[str, str], ...] = (
    (
        r"table: fault 'interlock'.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "The safety circuit (interlock) was opened; close the cover, then press “Reset the fault”",
        ),
    ),
    (
        r"table: fault 'watchdog'.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "The table's watchdog stopped it, the computer had fallen silent; press “Reset the fault”",
        ),
    ),
    (
        r"table: fault 'limit'.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "An axis ran into its limit; see what drove it there, then press “Reset the fault”",
        ),
    ),
    (
        r"table: fault 'drive'.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "The drive reports a fault; read its display, remove the cause, then press “Reset the fault”",
        ),
    ),
    (
        r"table: fault 'stall'.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "An axis is blocked or overloaded; free it, then press “Reset the fault”",
        ),
    ),
    (
        r"table: fault '(.*?)'.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "The table has latched the fault “{0}”; remove its cause, then press “Reset the fault”",
        ),
    ),
    (
        rf"{_ENGINE_DEAD}(.*?); the table's watchdog .*",
        QT_TRANSLATE_NOOP(
            "faults",
            "Its process ended unexpectedly{0}; the table's watchdog, where it has one, stops it and stays latched:"
            " look at the table, press “Reset the fault”, then start again or resume the run at its last finished"
            " stage",
        ),
    ),
    (
        r"engine: it gives no sign of life any more; the table's watchdog .*",
        QT_TRANSLATE_NOOP(
            "faults",
            "It gives no sign of life any more; the table's watchdog, where it has one, stops it and stays latched:"
            " look at the table; its fault is to be reset before you start again or resume the run at its last finished"
            " stage",
        ),
    ),
    (
        r"table: fault, it tells no cause;.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "The table has latched a fault and does not tell its cause; read its display, look at cover, limits and"
            " drives, remove the cause, then press “Reset the fault”",
        ),
    ),
    (
        r"IMU: a transfer to unit '(.*?)' was interrupted \(.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "Writing the registers of {0} was interrupted; press Understood, then finish it or take it back",
        ),
    ),
    (
        r"transfer \S+ to unit '(.*?)' was by IMU profile '(.*?)' \(product '(.*?)'\), this product's is '(.*?)';.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "Registers of {0} were written by IMU profile “{1}” (product “{2}”), this product has “{3}”; choose a"
            " product with that profile",
        ),
    ),
    (
        r"transfer \S+ to unit '(.*?)' has other parameters than the registers of IMU profile '(.*?)';.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "Registers of {0} were written for other parameters than those of IMU profile “{1}”; choose the product of"
            " that unit",
        ),
    ),
    (
        r"port (\S+) is in use by another calstation \(process (\d+) of (.*), since (.*)\);.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "{0} is in use by another calstation, process {1} of {2}, since {3}; wait for its end, or end it there",
        ),
    ),
    (
        r"(.*), line (\d+): .*, so it is not known what was written to unit '(.*?)';.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "Line {1} of {0} is damaged, so it is not known what was written to {2}; compare the unit's registers with"
            " those of its last result (Engineer page), then move this file away",
        ),
    ),
    (
        r"IMU: unit '(.*?)' has had its flash written (\d+) times of the (\d+) that IMU profile '(.*)' allows.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "The flash of {0} has been written {1} times, the IMU profile “{3}” allows {2}; take the unit out of"
            " service, or correct flash_cycles_max in the profile where its data sheet allows more",
        ),
    ),
    (
        r"(.*): its run is still going; stop it first",
        QT_TRANSLATE_NOOP("faults", "The run of {0} is still going; stop it first"),
    ),
    (
        r".*: began on station '(.*?)', this is '(.*?)';.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "The run began on station “{0}”, this is “{1}”; choose the station that it began on, then carry it on",
        ),
    ),
    (
        r".*: site\.confirmed_on is missing, .* latitude (\S*)°, longitude (\S*)°, height (\S*) m;.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "Nobody has confirmed at this computer that the station stands at {0}°, {1}°, {2} m, and gyros of this"
            " grade cannot tell; an engineer makes sure and confirms it on the page Station, in the section Site",
        ),
    ),
    (
        r".*: site\.confirmed_on names (.*), not '.* latitude (\S*)°, longitude (\S*)°, height (\S*) m;.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "Confirmed was “{0}”, not that the station stands at {1}°, {2}°, {3} m, at this computer; an engineer makes"
            " sure and confirms it on the page Station, in the section Site",
        ),
    ),
    (
        r".*: began on (?:hardware|the virtual bench), but station '(.*?)' is .* now;.*",
        QT_TRANSLATE_NOOP(
            "faults",
            "The run began on a virtual bench and station “{0}” is hardware now, or the other way round; start a new"
            " run",
        ),
    ),
)

#: What may stand behind a sentence: what the unit holds after it, or another way.
_BEHIND: tuple[tuple[str, str], ...] = (
    (
        r"; the unit was restarted and holds its old registers",
        QT_TRANSLATE_NOOP("faults", "The unit was restarted and holds its old registers."),
    ),
    (
        r"; the unit holds new registers, not yet proved: calstation registers finish \(or restore\) .*",
        QT_TRANSLATE_NOOP(
            "faults",
            "The unit holds its new registers, not yet proved: press Understood, then finish or take them back.",
        ),
    ),
    (
        r"; the unit holds neither old nor new registers: calstation registers finish \(or restore\) .*",
        QT_TRANSLATE_NOOP(
            "faults",
            "The unit holds neither its old nor its new registers: press Understood, then finish or take them back.",
        ),
    ),
    (
        r"; what the unit's flash holds will be seen at the next start",
        QT_TRANSLATE_NOOP("faults", "What the unit's flash holds will be seen at the next start."),
    ),
    (re.escape(OR_AT_REST), QT_TRANSLATE_NOOP("faults", "Or choose “Write, table at rest”.")),
)


@dataclass(frozen=True)
class FaultWords:
    """A fault as it is shown: where its cause is, what is wrong, what to do (may be empty)."""

    cause: str
    place: str
    reason: str
    mend: str

    @property
    def sentences(self) -> str:
        """What is wrong and what to do, one behind the other."""
        return f"{self.reason} {self.mend}".strip()


def word_fault(kind: str, text: str) -> FaultWords:
    """The words of a `Fault` of this kind and text; of a mistake of the program only its last line is shown."""
    if kind == "internal":
        return _internal(text)
    text, behind = _parted(text)
    if behind:
        words = word_fault(kind, text)
        return replace(words, mend=f"{words.mend} {QCoreApplication.translate('faults', behind)}".strip())
    cause = _cause(kind, text)
    for pattern, sentence in _REWORDED:
        if found := re.fullmatch(pattern, text, re.DOTALL):
            return _split(
                cause, QCoreApplication.translate("faults", sentence).format(*map(phrase, found.groups()))
            )
    said = _HEAD.sub("", translated(text), count=1) if text.startswith(_HEADS) else translated(text)
    return _split(cause, said)


def known(text: str) -> bool:
    """Whether the sentence can be said in every language."""
    while (parted := _parted(text))[1]:
        text = parted[0]
    return any(pattern.fullmatch(text) for pattern, _ in _patterns()) or any(
        re.fullmatch(pattern, text, re.DOTALL) for pattern, _ in _REWORDED
    )


def resettable(text: str) -> bool:
    """Whether the sentence tells of a fault that the table has latched, or may have, and an operator may reset."""
    return text.startswith(("table: fault '", "table: fault, ", _ENGINE_DEAD))


def _split(cause: str, said: str) -> FaultWords:
    reason, *mend = re.split(r"; |；", said, maxsplit=1)
    return FaultWords(cause, _place(cause), _sentence(reason), _sentence(mend[0] if mend else ""))


def _internal(text: str) -> FaultWords:
    last = text.strip().splitlines()[-1] if text.strip() else ""
    reason = QCoreApplication.translate("faults", "The program made a mistake: {0}").format(last)
    mend = QCoreApplication.translate(
        "faults",
        "Start the run again; if it comes back, send the log and this text to whoever looks after calstation.",
    )
    return FaultWords("engine", _place("engine"), reason, mend)


def _cause(kind: str, text: str) -> str:
    for head, cause in zip(_HEADS, ("table", "imu", "engine", "bench"), strict=True):
        if text.startswith(head):
            return cause
    return "configuration" if kind == "ConfigurationError" else "data" if "Input" in kind else "engine"


def _place(cause: str) -> str:
    return QCoreApplication.translate("faults", _CAUSES[cause])


def _parted(text: str) -> tuple[str, str]:
    """A sentence without the last of what may stand behind it, and that; "" where nothing does."""
    for pattern, behind in _BEHIND:
        if found := re.search(f"{pattern}$", text, re.DOTALL):
            return text[: found.start()], behind
    return text, ""


@cache
def _patterns() -> tuple[tuple[re.Pattern[str], str], ...]:
    return _compiled(SENTENCES)


@cache
def _phrases() -> tuple[tuple[re.Pattern[str], str], ...]:
    return _compiled(PHRASES)


def _compiled(sentences: Sequence[str]) -> tuple[tuple[re.Pattern[str], str], ...]:
    made = []
    for sentence in sentences:
        parts = re.split(r"\{\d\}", sentence)
        made.append((re.compile("(.*?)".join(re.escape(part) for part in parts), re.DOTALL), sentence))
    return tuple(made)


def translated(text: str) -> str:
    """The whole sentence, cause and mend with it, in the language in force where it is known."""
    for pattern, sentence in _patterns():
        found = pattern.fullmatch(text)
        if found:
            return QCoreApplication.translate("faults", sentence).format(*map(phrase, found.groups()))
    return text


def phrase(value: str) -> str:
    """A value of a sentence in the language in force: what a proof compared, or a phrase; any other as it is."""
    if value in _MEASURED:
        return QCoreApplication.translate("faults", _MEASURED[value])
    for pattern, words in _phrases():
        if found := pattern.fullmatch(value):
            return QCoreApplication.translate("faults", words).format(*map(phrase, found.groups()))
    return value


def _sentence(text: str) -> str:
    """With a capital and a full stop."""
    if not text:
        return ""
    text = text[0].upper() + text[1:]
    chinese = any("\u4e00" <= letter <= "\u9fff" for letter in text)
    return text if text[-1] in ".。!！" else text + ("。" if chinese else ".")
