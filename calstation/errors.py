"""The errors a user can meet, each with the exit code the command line gives for it."""


class CalstationError(Exception):
    """Base of every error that is told to a person in one or two lines; the text names field and mend."""

    exit_code = 2


class ConfigurationError(CalstationError):
    """A station, profile, product or command-line value is wrong (exit code 2)."""


class InputError(CalstationError):
    """A log or CSV cannot be used as it is (exit code 2)."""


class InsufficientDataError(InputError):
    """Too little data for a stage; the text says what is missing (exit code 2)."""


class DeviceFaultError(CalstationError):
    """A device or its link failed (exit code 3)."""

    exit_code = 3


class StoppedError(CalstationError):
    """The operator stopped the run (exit code 4)."""

    exit_code = 4
