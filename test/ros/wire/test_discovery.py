"""Tests of the environment of a robot's processes: local discovery, and a folder for logs."""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from rclpy.qos import ReliabilityPolicy

from delta3_pacdrive.errors import RunError
from delta3_pacdrive.ros.wire import discovery, interfaces

JOIN = (
    'from delta3_pacdrive.ros.wire import discovery; discovery.keep_to_this_machine(); '
    'import rclpy; rclpy.init(); rclpy.create_node("somebody").get_logger().info("here")'
)
VARIABLES = (discovery.PROFILE, discovery.LATER_PROFILE, discovery.RANGE, discovery.PEERS)
PLACES = ('HOME', 'ROS_HOME', 'ROS_LOG_DIR')
PROFILES = 'http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles'


def test_unwritable_log_folder_is_named(tmp_path, monkeypatch):
    (tmp_path / 'file').touch()
    for folder in (tmp_path / 'file', tmp_path / 'file' / 'log'):
        monkeypatch.setenv('ROS_LOG_DIR', str(folder))
        with pytest.raises(
            RunError,
            match=r"ROS_LOG_DIR is '/.*, where ROS 2 cannot write its logs: (File exists|Not a directory)",
        ):
            discovery.keep_to_this_machine()


@pytest.mark.skipif(os.getuid() == 0, reason='root may write everywhere')
def test_logs_are_written_to_another_folder_if_that_at_home_is_read_only(tmp_path, monkeypatch):
    (tmp_path / '.ros' / 'log').mkdir(parents=True)
    (tmp_path / '.ros' / 'log').chmod(0o555)
    monkeypatch.setenv('HOME', str(tmp_path))
    for name in ('ROS_HOME', 'ROS_LOG_DIR'):
        monkeypatch.delenv(name, raising=False)
    discovery.keep_to_this_machine()
    assert os.environ['ROS_LOG_DIR'] != str(tmp_path / '.ros' / 'log')


@pytest.mark.parametrize('home', [{}, {'HOME': ''}, {'HOME': '/proc'}, {'ROS_HOME': '/proc/1'}])
def test_node_starts_without_a_home_folder(home, tmp_path):
    environment = {key: value for key, value in os.environ.items() if key not in PLACES}
    environment |= home | {'TMPDIR': str(tmp_path)}
    command = [sys.executable, '-P', '-c', JOIN]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=120)
    assert (done.returncode, 'here' in done.stderr) == (0, True), done.stderr
    assert list(tmp_path.glob('delta3_pacdrive_*/log/*.log'))


def test_requested_folder_is_kept(monkeypatch, tmp_path):
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path))
    monkeypatch.setenv(discovery.RANGE, 'SUBNET')
    discovery.keep_to_this_machine()
    assert os.environ['ROS_LOG_DIR'] == str(tmp_path)
    assert os.environ[discovery.RANGE] == 'SUBNET'


@pytest.fixture
def alone(monkeypatch, tmp_path):
    """Remove the variables that limit the discovery of the tests' robots."""
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(discovery.MIDDLEWARE, 'rmw_fastrtps_cpp')
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    return tmp_path


def test_the_lease_outlasts_the_silence_of_a_busy_machine(alone):
    discovery.keep_to_this_machine()
    lease = next(ET.parse(os.environ[discovery.PROFILE]).iter(f'{{{PROFILES}}}leaseDuration'))
    assert [(item.tag.rpartition('}')[2], float(item.text)) for item in lease] == [('sec', 20.0)]


PEER = """
import os, signal, sys
from delta3_pacdrive.ros import discovery
discovery.keep_to_this_machine()
import rclpy
rclpy.init()
node = rclpy.create_node('peer')
print('here', flush=True)
signal.pause()
"""


def test_killed_process_leaves_the_domain_immediately_after_disposal_and_others_stay(graph):
    from delta3_pacdrive.ros.wire import domain

    def prefixes():
        infos = graph.listener.get_publishers_info_by_topic('/parameter_events')
        return {bytes(info.endpoint_gid[: domain.PREFIX_BYTES]) for info in infos if info.node_name == 'peer'}

    peers = [subprocess.Popen([sys.executable, '-P', '-c', PEER], stdout=subprocess.PIPE) for _ in range(2)]
    try:
        graph.spin_until(lambda: len(prefixes()) == 2, 'both peers')
        killed, other = peers
        killed.kill()
        killed.wait()
        of_pid = {int.from_bytes(prefix[4:6], 'little'): prefix for prefix in prefixes()}
        domain.dispose(of_pid[killed.pid & 0xFFFF], [discovery.HERE])
        graph.spin_until(lambda: prefixes() == {of_pid[other.pid & 0xFFFF]}, 'one peer', 5.0)
    finally:
        for peer in peers:
            peer.kill()
            peer.communicate()


def test_without_a_word_a_robot_keeps_to_this_machine(alone):
    discovery.keep_to_this_machine()
    assert os.environ[discovery.PROFILE].endswith('config/localhost.xml')
    assert os.environ[discovery.RANGE] == 'SYSTEM_DEFAULT'
    assert not discovery.exposure()
    assert interfaces.MDT.delivery.robot.reliability == ReliabilityPolicy.BEST_EFFORT


def addresses(xml, tag):
    found = ET.fromstring(xml).iter(f'{{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}}{tag}')
    return [
        address.text.strip()
        for parent in found
        for address in parent.iter()
        if address.tag.endswith('}address')
    ]


def test_peers_are_looked_for_and_listened_to_where_they_are_reached_and_nowhere_else(alone, monkeypatch):
    monkeypatch.setenv(discovery.PEERS, ' 192.0.2.7 ;localhost;192.0.2.5; ')
    monkeypatch.setattr(
        discovery, 'way_to', lambda address: {'127.0.0.1': '127.0.0.1'}.get(address, '192.0.2.1')
    )
    discovery.keep_to_this_machine()
    path = Path(os.environ[discovery.PROFILE])
    assert path.parent == alone / f'delta3_pacdrive_{os.getuid()}' / 'network'
    assert path.stat().st_mode & 0o022 == path.parent.stat().st_mode & 0o077 == 0
    text = path.read_text(encoding='utf-8')
    assert addresses(text, 'interfaceWhiteList') == ['127.0.0.1', '192.0.2.1']
    assert addresses(text, 'initialPeersList') == ['127.0.0.1', '192.0.2.5', '192.0.2.7']
    assert discovery.exposure()
    # what a network loses is repeated
    assert interfaces.MDT.delivery.robot.reliability == ReliabilityPolicy.RELIABLE
    discovery.keep_to_this_machine()  # as every process of the robot does
    assert os.environ[discovery.PROFILE] == str(path)


@pytest.mark.parametrize(
    ('peers', 'sentence'),
    [
        (
            'no such host',
            "ROS_STATIC_PEERS names 'no such host', which has no IPv4 address",
        ),
        (';'.join(f'192.0.2.{n}' for n in range(17)), 'names 17 machines, the limit is 16'),
        ('x' * 300, 'which has no IPv4 address'),
    ],
)
def test_invalid_peer_is_rejected_with_one_message(peers, sentence, alone, monkeypatch):
    monkeypatch.setenv(discovery.PEERS, peers)
    with pytest.raises(RunError, match=re.escape(sentence)) as refused:
        discovery.keep_to_this_machine()
    assert len(str(refused.value)) < 300


def test_route_to_this_machine_begins_here():
    assert discovery.way_to('127.0.0.1') == '127.0.0.1'


def test_folder_writable_by_other_users_receives_no_profile(alone, monkeypatch):
    folder = alone / f'delta3_pacdrive_{os.getuid()}' / 'network'
    folder.mkdir(parents=True, mode=0o700)
    folder.chmod(0o777)
    monkeypatch.setenv(discovery.PEERS, '127.0.0.1')
    with pytest.raises(RunError, match=f'no usable folder for the network: {folder}: other users can write'):
        discovery.keep_to_this_machine()


@pytest.mark.parametrize('empty', ['', ' '])
@pytest.mark.parametrize('name', [*VARIABLES, discovery.MIDDLEWARE])
def test_an_empty_variable_counts_as_unset(name, empty, alone, monkeypatch):
    monkeypatch.setenv(name, empty)
    discovery.keep_to_this_machine()
    assert os.environ[discovery.PROFILE].endswith('config/localhost.xml')
    assert os.environ[discovery.RANGE] == 'SYSTEM_DEFAULT'
    assert not discovery.exposure()


@pytest.mark.parametrize(('value', 'reach'), [('1', 'SUBNET'), ('1', None), ('0', None), ('', None)])
def test_the_deprecated_variable_is_removed_with_a_warning(value, reach, alone, monkeypatch, capfd):
    monkeypatch.setenv(discovery.LOCALHOST_ONLY, value)
    if reach:
        monkeypatch.setenv(discovery.RANGE, reach)
        monkeypatch.setenv(discovery.PEERS, '192.0.2.7')
    discovery.keep_to_this_machine()
    assert discovery.LOCALHOST_ONLY not in os.environ
    assert not discovery.exposure()
    ignored = '; so is ROS_AUTOMATIC_DISCOVERY_RANGE; so is ROS_STATIC_PEERS' if reach else ''
    assert capfd.readouterr().err == (
        'warning: ROS_LOCALHOST_ONLY is deprecated and ignored: a robot is restricted to this machine by default'
        f'{ignored}\n'
    )


@pytest.mark.parametrize('reach', ['OFF', 'localhost', 'EVERYWHERE'])
def test_a_range_that_no_robot_can_have_is_rejected(reach, alone, monkeypatch):
    monkeypatch.setenv(discovery.RANGE, reach)
    with pytest.raises(
        RunError, match=f"^ROS_AUTOMATIC_DISCOVERY_RANGE is '{reach}', but must be one of LOCALHOST,"
    ):
        discovery.keep_to_this_machine()


@pytest.mark.parametrize('name', [discovery.PROFILE, discovery.LATER_PROFILE])
def test_separate_profile_names_the_addresses_of_the_robot(name, alone, monkeypatch):
    own = alone / 'own.xml'
    monkeypatch.setenv(name, str(own))
    with pytest.raises(
        RunError, match=r'^FASTRTPS_DEFAULT_PROFILES_FILE names [^,]*, which is not a readable file$'
    ):
        discovery.keep_to_this_machine()
    own.write_text(discovery.profile_text([], []), encoding='utf-8')
    discovery.keep_to_this_machine()
    assert os.environ[discovery.PROFILE] == str(own)
    assert os.environ[discovery.RANGE] == 'SYSTEM_DEFAULT'
    assert discovery.exposure() == f'other machines may reach this robot: {discovery.PROFILE} is {own}'


@pytest.mark.parametrize('reach', ['SUBNET', 'SYSTEM_DEFAULT'])
def test_robot_reachable_from_other_hosts_gives_the_reason(reach, alone, monkeypatch):
    monkeypatch.setenv(discovery.RANGE, reach)
    discovery.keep_to_this_machine()
    assert discovery.exposure() == f'other machines may reach this robot: {discovery.RANGE} is {reach}'


def test_middleware_with_own_localhost_mode_is_configured(alone, monkeypatch):
    monkeypatch.setenv(discovery.MIDDLEWARE, 'rmw_cyclonedds_cpp')
    discovery.keep_to_this_machine()
    assert os.environ[discovery.RANGE] == 'LOCALHOST'
    assert discovery.PROFILE not in os.environ
    assert not discovery.exposure()
    monkeypatch.setenv(discovery.PEERS, '192.0.2.7')
    assert discovery.exposure()


def test_unverified_plan_is_rejected_unless_it_may_exceed_limits(alone, monkeypatch):
    monkeypatch.setenv(discovery.MIDDLEWARE, 'rmw_zenoh_cpp')
    with pytest.raises(RunError, match="RMW_IMPLEMENTATION is 'rmw_zenoh_cpp', which is not known"):
        discovery.keep_to_this_machine()
    monkeypatch.setenv(discovery.RANGE, 'SUBNET')
    discovery.keep_to_this_machine()
    assert discovery.exposure()


def test_invalid_peer_is_reported_with_one_message(tmp_path):
    environment = {
        key: value for key, value in os.environ.items() if key not in (discovery.PROFILE, discovery.RANGE)
    }
    command = [sys.executable, '-P', '-c', 'from delta3_pacdrive.ros.nodes.start import plant; plant()']
    done = subprocess.run(
        command,
        env=environment | {discovery.PEERS: '???'},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.stderr == "error: ROS_STATIC_PEERS names '???', which has no IPv4 address\n"
