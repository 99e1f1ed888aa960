"""The operator of a robot between two hosts: drives programs, and brings the robot back after a fault.

A process of the near host. It reads a line for each case, the path of a program, and writes lines of JSON: that the
robot moves, what the run came to, and how long it took to bring the robot back to its start.
"""

import json
import math
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from delta3_pacdrive.errors import Delta3Error, RunError
from delta3_pacdrive.ros.robot_client import OperatorNode, operating

APPEAR_S = 120.0  # for the robot to come up
RUN_S = 300.0  # for a program to end, one way or another
BACK_S = 90.0
AGAIN_S = 0.2  # between two tries
COUNTED = (
    'cycles',
    'overruns',
    'slip_s',
    'lost_telegrams',
    'repeated_telegrams',
    'bus_time_s',
    'wall_time_s',
)
START_M, THERE_M = (0.0, 0.0, -0.75), 1e-4  # of experiment 1, and how near to it the robot is there
BACK = f'moves: [{{move_l: {{to_m: {list(START_M)}}}}}]'


def _is_ready(operator: OperatorNode) -> bool:
    progress = operator.progress
    return bool(
        progress.get('phase') == 'CP4'
        and progress['in_torque']
        and operator.state == 'idle'
        and operator.queue
    )


def _run(operator: OperatorNode, program: str) -> dict[str, Any]:
    """Drive a program; return what it came to."""
    operator.send_program(program)
    before = dict(operator.progress)
    operator.call('start')
    _tell({'moving': True})
    session = before['session']

    def is_over() -> bool:
        progress = operator.progress
        return bool(progress.get('fault') or progress.get('session', session) != session) or (
            progress.get('state') == 'idle' and operator.state == 'idle'
        )

    operator.wait_until(is_over, 'end of the program', RUN_S)
    after = operator.progress
    told = {name: after.get(name, 0) - before[name] for name in COUNTED}
    return {'fault': after.get('fault', ''), **told}


def _bring_back(operator: OperatorNode) -> float:
    """Bring the robot back to its start after whatever has happened; return how long it took [s]."""
    begin = time.monotonic()
    while time.monotonic() < begin + BACK_S:
        with suppress(Delta3Error):
            progress = operator.progress
            if progress.get('phase') == 'CP4':
                if operator.state in ('stopped', 'moving', 'stopping'):
                    operator.call('abort')
                if progress['fault']:
                    operator.call('reset')
                if not progress['in_torque']:
                    operator.enable(True)
                if _is_ready(operator):
                    operator.call('clear')
                    if math.dist(operator.progress['tcp_m'], START_M) <= THERE_M:
                        return time.monotonic() - begin
                    operator.move(BACK)
                    operator.wait_until(lambda: operator.state == 'moving', 'start', 5.0)
                    operator.wait_until(lambda: operator.state == 'idle', 'end of the way back', 60.0)
        operator.spin_for(AGAIN_S)
    raise RunError(f'the robot is not back within {BACK_S:g} s: {operator.progress}')


def _tell(what: dict[str, Any]) -> None:
    print(json.dumps(what), flush=True)


def main() -> int:
    """Operate until there is nothing more to be driven; return the exit status."""
    try:
        with operating('/') as operator:
            operator.wait_until(lambda: _is_ready(operator), 'robot', APPEAR_S)
            _tell({'ready': True})
            for line in sys.stdin:
                _tell(_run(operator, Path(line.strip()).read_text(encoding='utf-8')))
                _tell({'back_s': _bring_back(operator)})
    except Delta3Error as error:
        _tell({'error': str(error)})
        return 1
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
