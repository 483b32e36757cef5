"""Sounds after a scan, for an operator who looks at the unit: a short tick if accepted, a low tone if refused."""

import logging
import threading
import time
from pathlib import Path
from typing import Literal

_FOLDER = Path(__file__).parent / "sounds"

#: Time for which the device stays open, s: longer than each sound and the delay of the device.
_OPEN_S = 1.0

#: Names of the sound services used. ALSA is excluded because its library prints to the terminal if there is no device.
_SERVICES = ("WASAPI", "COREAUDIO", "PULSEAUDIO")

logger = logging.getLogger(__name__)


def play(name: Literal["accepted", "refused"]) -> None:
    """Play a sound in the background; without a sound device nothing happens."""
    threading.Thread(target=_play, args=(name,), name=f"sound {name}", daemon=True).start()


def _play(name: str) -> None:
    try:
        import miniaudio  # loads a library that only a scan needs
    except ImportError:  # miniaudio is available only for common platforms
        return
    try:
        with miniaudio.PlaybackDevice(backends=[miniaudio.Backend[service] for service in _SERVICES]) as device:
            device.start(miniaudio.stream_file(str(_FOLDER / f"{name}.wav")))
            time.sleep(_OPEN_S)
    except miniaudio.MiniaudioError as error:
        logger.info("no sound was played: %s", error)
