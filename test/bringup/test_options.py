"""Facts about what a bring-up refuses before its first process starts."""

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.bringup.options import Options, check_options
from delta3_pacdrive.errors import ParameterError


def test_a_robot_with_a_rotary_axis_is_refused_by_name(robot, tmp_path):
    path = tmp_path / 'turning.yaml'
    parameters.write(robot.replace(rotary__present=True), path)
    with pytest.raises(
        ParameterError, match=r'the graph drives no rotary axis yet, but rotary\.present is true'
    ):
        check_options(Options(None, path))
    parameters.write(robot, path)
    assert not check_options(Options(None, path))[0].rotary.present
