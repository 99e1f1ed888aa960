"""Checks every report that a test of this folder writes: tables, text and figures against the summary."""

import pytest

from delta3_pacdrive.studies.framework import figure_style, report_folder
from pictures import undrawn
from reports_read import reading


@pytest.fixture(scope='session', autouse=True)
def _reports_are_read():
    with reading(), undrawn():
        yield


@pytest.fixture
def drawn(monkeypatch):
    """Draw the pictures of reports."""
    monkeypatch.setattr(report_folder, 'save', figure_style.save)
