"""The environment of a robot's processes: this machine only, and a folder for logs wherever they run."""

import os
import subprocess
import sys

import pytest

from delta3_pacdrive.ros import discovery

JOIN = (
    'from delta3_pacdrive.ros import discovery; discovery.keep_to_this_machine(); '
    'import rclpy; rclpy.init(); rclpy.create_node("somebody").get_logger().info("here")'
)
PLACES = ('HOME', 'ROS_HOME', 'ROS_LOG_DIR')


@pytest.mark.parametrize('home', [{}, {'HOME': ''}, {'HOME': '/proc'}, {'ROS_HOME': '/proc/1'}])
def test_a_node_starts_where_nobody_has_a_home(home, tmp_path):
    environment = {key: value for key, value in os.environ.items() if key not in PLACES}
    environment |= home | {'TMPDIR': str(tmp_path)}
    command = [sys.executable, '-P', '-c', JOIN]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=120)
    assert (done.returncode, 'here' in done.stderr) == (0, True), done.stderr
    assert list(tmp_path.glob('delta3_pacdrive_*_log/*.log'))


def test_a_folder_that_is_asked_for_stays(monkeypatch, tmp_path):
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path))
    monkeypatch.setenv(discovery.RANGE, 'SUBNET')
    discovery.keep_to_this_machine()
    assert os.environ['ROS_LOG_DIR'] == str(tmp_path)
    assert os.environ[discovery.RANGE] == 'SUBNET'
