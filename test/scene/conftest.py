"""Shared fixtures of the tests of the scene."""

import pytest

from scenes import ROBOTS


@pytest.fixture(params=ROBOTS.values(), ids=ROBOTS.keys())
def machine(request, robot):
    return robot.replace(**request.param)
