"""The operator of a robot between two hosts: runs programs, and recovers the robot after a fault.

This process of the near host reads the path of a program per case from standard input, and writes lines of JSON: that
the robot moves, the result of the run, and the recovery time.
"""

import json
import math
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from delta3_pacdrive.errors import Delta3Error, RunError
from delta3_pacdrive.ros.clients.robot_client import OperatorNode, operating

APPEAR_S = 120.0  # timeout for the robot
RUN_S = 300.0  # timeout of a program
BACK_S = 90.0  # timeout of the recovery
AGAIN_S = 0.2  # between two attempts
COUNTED = (
    'cycles',
    'overruns',
    'slip_s',
    'lost_telegrams',
    'repeated_telegrams',
    'bus_time_s',
    'wall_time_s',
)
START_M, THERE_M = (0.0, 0.0, -0.75), 1e-4  # start of experiment 1, and tolerance
BACK = f'moves: [{{move_l: {{to_m: {list(START_M)}}}}}]'


def _is_ready(operator: OperatorNode) -> bool:
    progress = operator.progress
    return bool(
        progress.phase == 'CP4' and progress.in_torque and operator.state == 'idle' and operator.queue
    )


def _run(operator: OperatorNode, program: str) -> dict[str, Any]:
    """Run a program; return its result."""
    operator.send_program(program)
    before = operator.progress
    operator.call('start')
    _write({'moving': True})
    session = before.session

    def is_over() -> bool:
        progress = operator.progress
        return bool(progress.fault or progress.session != session) or (
            progress.state == 'idle' and operator.state == 'idle'
        )

    operator.wait_until(is_over, 'end of the program', RUN_S)
    after = operator.progress
    counted = {name: getattr(after, name) - getattr(before, name) for name in COUNTED}
    return {'fault': after.fault, **counted}


def _bring_back(operator: OperatorNode) -> float:
    """Recover the robot and move it to its start; return the required time [s]."""
    begin = time.monotonic()
    while time.monotonic() < begin + BACK_S:
        with suppress(Delta3Error):
            progress = operator.progress
            if progress.phase == 'CP4':
                if operator.state in ('stopped', 'moving', 'stopping'):
                    operator.call('abort')
                if progress.fault:
                    operator.call('reset')
                if not progress.in_torque:
                    operator.enable(True)
                if _is_ready(operator):
                    operator.call('clear')
                    place = operator.progress.tcp_m
                    if place is not None and math.dist(place, START_M) <= THERE_M:
                        return time.monotonic() - begin
                    operator.move(BACK)
                    operator.wait_until(lambda: operator.state == 'moving', 'start', 5.0)
                    operator.wait_until(lambda: operator.state == 'idle', 'end of the return move', 60.0)
        operator.spin_for(AGAIN_S)
    raise RunError(f'the robot is not back within {BACK_S:g} s: {operator.progress}')


def _write(document: dict[str, Any]) -> None:
    print(json.dumps(document), flush=True)


def main() -> int:
    """Run programs until the end of the input; return the exit status."""
    try:
        with operating('/') as operator:
            operator.wait_until(lambda: _is_ready(operator), 'robot', APPEAR_S)
            _write({'ready': True})
            for line in sys.stdin:
                _write(_run(operator, Path(line.strip()).read_text(encoding='utf-8')))
                _write({'back_s': _bring_back(operator)})
    except Delta3Error as error:
        _write({'error': str(error)})
        return 1
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
