"""Facts about the process of a node."""

import json
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


def test_a_node_that_cannot_leave_the_graph_tells_where_it_stands_and_ends() -> None:
    done = subprocess.run(
        [sys.executable, '-P', '-c', STUCK], capture_output=True, text=True, timeout=120.0, check=False
    )
    assert done.returncode == 1
    assert done.stdout == 'spins\n'
    assert done.stderr.startswith('Timeout (0:00:00.5')
    assert ' in close\n' in done.stderr
