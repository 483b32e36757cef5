"""A second opinion on a log and its certificate, DCC or result; it imports nothing of calstation."""

from .verify import main
