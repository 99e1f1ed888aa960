"""Every block of the pages that need a robot runs as printed. All other pages: ``../docs``."""

import pytest

import pages
from thoroughness import some

WITH_ROBOT = [page for page in pages.PAGES if pages.needs_robot(page)]
IN_EACH_RUN = [pages.FIRST]  # the commands of all others are read (test/docs)


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    'page', some(WITH_ROBOT, IN_EACH_RUN), ids=lambda page: str(page.relative_to(pages.SOURCE))
)
def test_every_block_of_the_page_runs_unchanged(page, tmp_path, nothing_left_behind):
    pages.run_page(page, tmp_path)
