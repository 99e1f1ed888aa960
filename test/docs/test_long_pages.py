"""Every block of the pages with long computations runs as printed, in a separate worker."""

import pytest

import pages


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize('page', pages.LONG, ids=lambda page: page.name)
def test_every_block_of_a_long_page_runs_unchanged(page, tmp_path):
    pages.run_page(page, tmp_path)
