"""Common functions of the benchmarks: a process per case, a long program, and the format of times."""

import json
import os
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from delta3_pacdrive.errors import Delta3Error, RunError


def program_file(seconds: float, folder: str) -> Path:
    """Write experiment 1, repeated to last approximately this long [s]."""
    import yaml

    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.configuration import yaml_file
    from delta3_pacdrive.errors import ProgramError
    from delta3_pacdrive.planning import program_planner
    from delta3_pacdrive.planning.program import file_reader as programs

    robot = core.load()
    source = programs.find('experiment1')
    once = programs.load(source, robot.motion)
    planned = program_planner.plan(once, once.start_m or robot.motion.home_m, robot)
    document = yaml_file.read(source, 'program file', ProgramError)
    document['repeat'] = max(1, round(seconds / planned.plan.duration_s))
    path = Path(folder) / 'benchmark.yaml'
    path.write_text(yaml.safe_dump(document), encoding='utf-8')
    return path


def in_child(action: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Run an action in a forked process and return its result: ROS can be started only once per process."""
    read_end, write_end = os.pipe()
    pid = os.fork()
    if pid == 0:
        status = 1
        try:
            os.close(read_end)
            with os.fdopen(write_end, 'w') as pipe:
                pipe.write(json.dumps(_outcome(action)))
            status = 0
        except (KeyboardInterrupt, BrokenPipeError):  # the parent reports it, or has ended
            pass
        except BaseException:  # noqa: BLE001 (a forked child must never return into its parent's code)
            traceback.print_exc()
        finally:
            os._exit(status)
    os.close(write_end)
    with os.fdopen(read_end) as pipe:
        text = pipe.read()
    if os.waitpid(pid, 0)[1] != 0:
        raise RunError('the case ended without a result')
    result = dict(json.loads(text))
    if 'error' in result:
        raise RunError(result['error'])
    return result


def _outcome(action: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    try:
        return action()
    except (Delta3Error, OSError) as error:  # also report errors of the system
        return {'error': str(error)}


def times_text(values: dict[str, float]) -> str:
    """Format p50, p99, p99.9 and maximum of times."""
    return ' / '.join(f'{value:.2f}' for value in values.values()) + ' ms'
