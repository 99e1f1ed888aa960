"""Tests of the process of a node."""

import json
import signal
import subprocess
import sys

# at the moment at which cyclic operation would begin
BEGIN = """
import gc, json
from delta3_pacdrive import memory
from delta3_pacdrive.ros import node_process
memory.collect_seldom()
before = gc.get_threshold()
node_process.Process.spin = lambda process: print(json.dumps([before, gc.get_threshold(), gc.get_freeze_count()]))
raise SystemExit(node_process.run([], []))
"""


def test_cyclic_operation_begins_with_short_looks_for_garbage() -> None:
    done = subprocess.run(
        [sys.executable, '-P', '-c', BEGIN], capture_output=True, text=True, timeout=120.0, check=True
    )
    before, then, frozen = json.loads(done.stdout)
    assert then[0] < 1000 < before[0]
    assert frozen > 10_000


# a signal at each line of what takes the lock of the future that ends a spin
INTERRUPTED = """
import sys
import rclpy
from delta3_pacdrive.ros import node_process
rclpy.init()
for line in range(1, 8):
    process, seen = node_process.Process(), []

    def interrupt(frame, event, _):
        if frame.f_code.co_name == 'add_done_callback' and event == 'line':
            seen.append(frame.f_lineno)
            if len(seen) == line:
                process.stop()
        return interrupt

    sys.settrace(interrupt)
    process.spin()
    sys.settrace(None)
    assert len(seen) >= line
"""


def test_a_signal_at_any_line_of_the_begin_of_a_spin_ends_it(graph: object) -> None:
    subprocess.run([sys.executable, '-P', '-c', INTERRUPTED], timeout=120.0, check=True)


# in real time it would take a core for ever, once whoever started it is gone
STUCK = """
import sys
import rclpy
from delta3_pacdrive.ros import node_process
node_process.NODES_LEAVE_S = 0.5
node_process.Process.spin = lambda process: print('spins', flush=True)
def close(process):
    while True:
        pass
node_process.Process.close = close
node_process.run([], [])
"""


def test_node_that_cannot_leave_the_graph_reports_its_stack_and_ends() -> None:
    done = subprocess.run(
        [sys.executable, '-P', '-c', STUCK], capture_output=True, text=True, timeout=120.0, check=False
    )
    assert done.returncode == 1
    assert done.stdout == 'spins\n'
    assert done.stderr.startswith('Timeout (0:00:00.5')
    assert ' in close\n' in done.stderr


# with a patience of a fraction of a second; each node says which participant it is
DEAF = """
import sys
from delta3_pacdrive.ros import discovery, node_process
from delta3_pacdrive.ros.robot_node import RobotNode
node_process.REJOIN_S = 0.2
discovery.keep_to_this_machine()

class Deaf(RobotNode):
    def __init__(self):
        super().__init__('deaf')
        self.partners = node_process.PartnerWatch(self.get_logger().warning, 0.01)
        self.now_s = 0.0
        self.create_timer(0.01, self.look)
        info, = self.get_publishers_info_by_topic('/parameter_events')
        print(bytes(info.endpoint_gid[:12]).hex(), node_process.rejoins(), flush=True)

    def look(self):
        self.now_s += 0.05
        if node_process.rejoins() == 2:
            self.partners.received('master')
        self.partners.update(('master',), self.now_s)

factories = [Deaf] * int(sys.argv[1])
raise SystemExit(node_process.run(factories, []))
"""


def test_node_without_messages_rejoins_the_domain_until_it_finds_its_partner(graph: object) -> None:
    process = subprocess.Popen(
        [sys.executable, '-P', '-c', DEAF, '1'], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    joined = [process.stdout.readline().split() for _ in range(3)]
    process.send_signal(signal.SIGTERM)
    rest, errors = process.communicate(timeout=60.0)
    assert (process.returncode, rest) == (0, '')
    assert len({identity for identity, _ in joined}) == 3
    assert [int(count) for _, count in joined] == [0, 1, 2]
    assert errors.count('no message from master for 0.2 s') == 1
    assert errors.count('no message from master for 0.4 s') == 1  # twice as long


# asked to end in the moment in which it joins anew
ENDED = """
import os, signal
from delta3_pacdrive.ros import discovery, node_process
from delta3_pacdrive.ros.robot_node import RobotNode
discovery.keep_to_this_machine()

class Recorder(RobotNode):
    def __init__(self):
        super().__init__('recorder')
        self.create_timer(0.01, self.look)

    def look(self):
        node_process._current.rejoin()

    def destroy_node(self):
        print('kept' if node_process.is_rejoining() else 'completed', flush=True)
        os.kill(os.getpid(), signal.SIGTERM)
        super().destroy_node()

raise SystemExit(node_process.run([Recorder], []))
"""


def test_node_ended_during_rejoining_completes_the_started_step(graph: object) -> None:
    done = subprocess.run(
        [sys.executable, '-P', '-c', ENDED], capture_output=True, text=True, timeout=120.0, check=False
    )
    assert (done.returncode, done.stdout.split()) == (0, ['kept', 'completed']), done.stderr
