"""What the facts about the scene share."""

import pytest

from scenes import ROBOTS


@pytest.fixture(params=ROBOTS.values(), ids=ROBOTS.keys())
def machine(request, robot):
    return robot.replace(**request.param)
