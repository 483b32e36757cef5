"""Fixtures of the shared database."""

from tests.postgres import postgres as postgres
from tests.postgres import shared_database as shared_database
from tests.postgres import url as url
