"""Tests of folders and lock files that no other user of the machine can replace."""

import os
import stat
import subprocess
import sys
import threading
from contextlib import ExitStack

import pytest

from delta3_pacdrive import private_files
from delta3_pacdrive.bringup.environment import only_one
from delta3_pacdrive.errors import RunError

OTHER = 4002  # number of another user, and of a group
PRIVATE, STICKY, OPEN = 0o700, 0o1777, 0o777
WAIT_S = 30.0
LOCK = """
import sys
from pathlib import Path
from delta3_pacdrive import private_files
with private_files.lock(Path(sys.argv[1])):
    print('locked', flush=True)
    sys.stdin.read()
"""

as_root = pytest.mark.skipif(os.getuid() != 0, reason='only root can give a folder to another user')


def test_a_missing_folder_is_created_for_this_user_alone(tmp_path):
    found = private_files.private_folder(tmp_path / 'a' / 'b')
    assert found == (tmp_path / 'a' / 'b').resolve()
    assert [stat.S_IMODE(folder.stat().st_mode) for folder in (found, found.parent)] == [PRIVATE, PRIVATE]
    assert private_files.private_folder(found) == found


@pytest.mark.parametrize('depth', [0, 1, 2])
@pytest.mark.parametrize('mode', [OPEN, 0o702, 0o722])
def test_a_folder_that_others_can_write_is_rejected_anywhere_in_the_path(depth, mode, tmp_path):
    path = tmp_path / 'a' / 'b' / 'c'
    path.mkdir(parents=True, mode=PRIVATE)
    (path, *path.parents)[depth].chmod(mode)
    with pytest.raises(PermissionError, match='other users can write to it'):
        private_files.private_folder(path)


def test_a_sticky_folder_may_lie_above_a_private_folder_but_is_not_one(tmp_path):
    tmp_path.chmod(STICKY)
    private_files.private_folder(tmp_path / 'mine')
    with pytest.raises(PermissionError, match='other users can write to it'):
        private_files.private_folder(tmp_path)


@as_root
@pytest.mark.parametrize(('group', 'accepted'), [(0, True), (OTHER, False)])
def test_a_group_with_other_members_must_not_write(group, accepted, tmp_path):
    folder = tmp_path / 'shared'
    folder.mkdir()
    os.chown(folder, -1, group)
    folder.chmod(0o770)
    with ExitStack() as stack:
        if not accepted:
            stack.enter_context(pytest.raises(PermissionError, match='other users can write to it'))
        private_files.private_folder(folder / 'mine')


@as_root
@pytest.mark.parametrize('depth', [0, 1, 2])
def test_a_folder_of_another_user_is_rejected_anywhere_in_the_path(depth, tmp_path):
    path = tmp_path / 'a' / 'b' / 'c'
    path.mkdir(parents=True, mode=PRIVATE)
    os.chown((path, *path.parents)[depth], OTHER, OTHER)
    with pytest.raises(PermissionError, match=f'it belongs to user {OTHER}'):
        private_files.private_folder(path)


def test_a_link_of_this_user_is_followed_to_a_folder_that_is_checked_as_well(tmp_path):
    (tmp_path / 'safe').mkdir(mode=PRIVATE)
    (tmp_path / 'open').mkdir()
    (tmp_path / 'open').chmod(OPEN)
    link = tmp_path / 'link'
    link.symlink_to(tmp_path / 'safe')
    assert private_files.private_folder(link / 'mine') == (tmp_path / 'safe' / 'mine').resolve()
    link.unlink()
    link.symlink_to(tmp_path / 'open')
    with pytest.raises(PermissionError, match='other users can write to it'):
        private_files.private_folder(link / 'mine')


@as_root
def test_a_link_of_another_user_is_rejected_wherever_it_leads(tmp_path):
    tmp_path.chmod(STICKY)
    (tmp_path / 'mine').mkdir(mode=PRIVATE)
    link = tmp_path / 'link'
    link.symlink_to(tmp_path / 'mine')
    os.lchown(link, OTHER, OTHER)
    with pytest.raises(PermissionError, match=f'it belongs to user {OTHER}'):
        private_files.private_folder(link)


def test_a_file_in_the_path_is_rejected(tmp_path):
    (tmp_path / 'file').touch()
    with pytest.raises(PermissionError, match='it is not a folder'):
        private_files.private_folder(tmp_path / 'file' / 'mine')


@pytest.mark.parametrize(
    ('kind', 'reason'),
    [('link', 'symbolic links'), ('pipe', 'not a regular file'), ('folder', 'Is a directory')],
)
def test_lock_that_is_not_a_regular_file_is_rejected_immediately(kind, reason, tmp_path):
    path, victim = tmp_path / 'lock', tmp_path / 'victim'
    victim.write_text('precious')
    {'link': lambda: path.symlink_to(victim), 'pipe': lambda: os.mkfifo(path), 'folder': path.mkdir}[kind]()
    with pytest.raises(OSError, match=reason), private_files.lock(path):
        pytest.fail('it was locked')
    assert victim.read_text() == 'precious'


def test_a_lock_is_free_when_its_holder_is_killed_and_its_file_stays_the_same(tmp_path):
    path = tmp_path / 'lock'
    holder = subprocess.Popen(
        [sys.executable, '-P', '-c', LOCK, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert holder.stdout.readline() == b'locked\n'
    before = path.stat().st_ino
    with pytest.raises(BlockingIOError), private_files.lock(path):
        pytest.fail('two processes hold it')
    holder.kill()
    holder.communicate(timeout=WAIT_S)
    with private_files.lock(path):
        pass
    assert path.stat().st_ino == before


def test_two_robots_never_hold_one_namespace_when_a_third_one_ends(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '0')
    gate, opened, held = threading.Event(), threading.Event(), []
    flock = private_files.fcntl.flock

    def slow(file, operation):
        if threading.current_thread().name == 'slow' and not opened.is_set():
            opened.set()
            gate.wait(WAIT_S)
        return flock(file, operation)

    monkeypatch.setattr(private_files.fcntl, 'flock', slow)

    def hold():
        with only_one(f'/facts_{os.getpid()}'):
            held.append('slow')
            ended.wait(WAIT_S)

    ended, other = threading.Event(), threading.Thread(target=hold, name='slow')
    try:
        with only_one(f'/facts_{os.getpid()}'):
            other.start()
            assert opened.wait(WAIT_S)
        gate.set()
        while not held:
            other.join(0.01)
        with pytest.raises(RunError, match='a robot is already up'), only_one(f'/facts_{os.getpid()}'):
            pytest.fail('two robots hold it')
    finally:
        ended.set()
        other.join()
