"""Every report of a study that a test of this folder writes is read: tables, text and figures against the summary."""

import pytest

from reports_read import reading


@pytest.fixture(scope='session', autouse=True)
def _reports_are_read():
    with reading():
        yield
