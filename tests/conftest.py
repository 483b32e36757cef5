"""For all tests: processes are lent (`lent`)."""

import lent

lent.install()
