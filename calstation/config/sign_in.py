"""Operators of a station who sign in with a badge."""

import re
from typing import Annotated

from pydantic import Field, model_validator

from calstation.errors import ConfigurationError
from calstation.schema import EntryError, Pattern, StrictModel


class SignInSection(StrictModel):
    """`[sign_in]` of a station: every run needs the badge of its operator."""

    badge_pattern: Pattern  #: Regular expression for the whole badge.
    #: Names by badge; if there are any, other badges are refused.
    names: dict[str, Annotated[str, Field(min_length=1)]] = Field(default_factory=dict)
    #: Badges of the engineers, who release failed units and confirm for one another, each with a personal PIN.
    engineers: list[str] = Field(default_factory=list)
    idle_minutes: float | None = Field(default=None, gt=0)  #: Idle time after which the window signs the operator out.

    @model_validator(mode="after")
    def _badges(self) -> "SignInSection":
        for badge in self.names:
            if not self.is_badge(badge):
                raise EntryError("station.badge_unlike", "names", badge=badge, pattern=self.badge_pattern)
        for badge in self.engineers:
            if not self.is_badge(badge):
                raise EntryError("station.badge_unlike", "engineers", badge=badge, pattern=self.badge_pattern)
            if self.names and badge not in self.names:
                raise EntryError("station.engineer_unnamed", "engineers", badge=badge)
        return self

    def is_badge(self, text: str) -> bool:
        """Return whether a text has the form of a badge."""
        return re.fullmatch(self.badge_pattern, text) is not None

    def operator(self, badge: str | None) -> str:
        """Return the name of the operator with a badge, or the badge if the station lists no names.

        Raises ConfigurationError if the badge is missing or not accepted.
        """
        if not badge:
            raise ConfigurationError("station.badge_missing")
        if badge not in self.names and (self.names or not self.is_badge(badge)):
            raise ConfigurationError("station.badge_unknown", badge=badge)
        return self.names.get(badge, badge)
