"""Run a script on the robot of ``delta3 run``, in a thread next to the bring-up."""

import os
import select
import sys
import threading
from collections.abc import Callable
from typing import Any

from delta3_pacdrive.bringup.scheduling import Schedule, set_scheduling
from delta3_pacdrive.cli.output import NAME_WIDTH, parts_rows
from delta3_pacdrive.errors import Delta3Error, Reason, ScriptError
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.scripting.connected_link import connected
from delta3_pacdrive.scripting.robot import Robot
from delta3_pacdrive.scripting.script import Script
from delta3_pacdrive.scripting.source_position import ScriptPlace

ASKED_S = 0.1  # polling period for a stop by the operator
HOLD_S = 5.0  # timeout of an interrupted script to stop the robot on its path


class ScriptRun:
    """Starts a script as soon as the robot is ready, and stops the bring-up when the script ends.

    Parameters
    ----------
    shown
        Callback for the progress of the bring-up.
    step
        Ask the operator before each move.

    """

    def __init__(
        self,
        script: Script,
        bringup: Any,
        shown: Callable[[MotionProgress], None],
        step: bool = False,
    ) -> None:
        self._script, self._bringup, self._shown, self._step = script, bringup, shown, step
        self._thread: threading.Thread | None = None
        self._node: Any = None
        self._robot: Robot | None = None
        self.error: ScriptError | None = None
        self.ended = self.interrupted = False  # completed; stopped by the operator

    def show(self, progress: MotionProgress) -> None:
        """Show the progress; the first call starts the script."""
        if self._thread is None:
            from delta3_pacdrive.ros.clients.script_client import ScriptNode

            self._node = ScriptNode(namespace=self._bringup.options.namespace)
            self._bringup.add(self._node)
            self._thread = threading.Thread(target=self._run, name='script', daemon=True)
            self._thread.start()
        over = self.ended or self.error is not None
        if self._bringup.interrupted and self._thread.is_alive() and not over:
            self.interrupted = True
            self._node.stop()
            self._await_end()
        self._shown(progress)

    def _await_end(self) -> None:
        """Keep the bring-up running while the robot stops on its path."""
        looks = round(HOLD_S / 0.05)
        while self._thread is not None and self._thread.is_alive() and looks > 0:
            self._bringup.poll(0.05)
            looks -= 1

    def _run(self) -> None:
        if self._bringup.options.real_time_priority:
            set_scheduling(
                Schedule.PREFERRED
            )  # the robot waits for the plans of the script, or continues without them
        try:
            with connected(self._node, self._script.name) as robot:
                self._robot = robot
                if self._step:
                    robot.step_by_step(self._ask)
                self._script.run(robot)
            self.ended = True
        except ScriptError as error:
            self.error = error
        except KeyboardInterrupt:
            self.interrupted = True
        except Delta3Error as error:
            self.error = ScriptError(Reason.of(error))
        finally:
            self._bringup.stop()

    def _ask(self, place: ScriptPlace, kind: str) -> None:
        """Wait until the operator confirms a move; end of input ends the script."""
        print(f'{place}: {kind}? Enter executes it, Ctrl-C ends', file=sys.stderr, flush=True)
        while not select.select([sys.stdin], [], [], ASKED_S)[0]:
            if self._node.stopped:
                raise KeyboardInterrupt
        while (read := os.read(sys.stdin.fileno(), 1)) != b'\n':  # leave further lines to later moves
            if not read:
                raise KeyboardInterrupt

    def result(self) -> dict[str, Any]:
        """Return the result of the script."""
        robot = self._robot
        return {
            'program': self._script.name,
            'notices': [] if robot is None else list(robot.notices),
            'late_decisions': 0 if robot is None else robot.late,
            'late_cycles_max': 0 if robot is None else robot.late_cycles,
            'held_at_cycle': None if robot is None or robot.held_at < 0 else robot.held_at,
        }


def text(result: dict[str, Any]) -> list[str]:
    """Return the result of a script as lines of text."""
    from delta3_pacdrive.studies.framework.columns import named_lines

    rows = [('bus time', f'{result["bus_time_s"]:.3f} s in {result["cycles"]} cycles')]
    if late := result['late_decisions']:
        most = result['late_cycles_max']
        rows.append(('late', f'{late} decisions took effect late, by at most {most} bus cycles'))
    if result['held_at_cycle'] is not None:
        rows.append(('held', f'on its path, at rest from bus cycle {result["held_at_cycle"]}'))
    if 'cell' in result:
        rows += parts_rows(result['cell'])
    rows += [('note', notice) for notice in result['notices']]
    rows.append(('bus', f'{result["overruns"]} overruns, {result["lost_telegrams"]} lost AT'))
    return named_lines(rows, NAME_WIDTH)


def held_text(cycle: int | None) -> str:
    """Return the message for an interrupted script."""
    if cycle is None:
        return 'interrupted'
    return f'interrupted: the robot was held on its path and is at rest from bus cycle {cycle}'
