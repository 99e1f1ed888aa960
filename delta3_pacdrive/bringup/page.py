"""The page of a robot, in a process that is started before anything of the robot is loaded.

Loading the page and its client takes longer than starting the robot.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from delta3_pacdrive import interrupts
from delta3_pacdrive.bringup.processes import ManagedProcess, end_all, killed_sentence, respawn
from delta3_pacdrive.bringup.scheduling import Schedule
from delta3_pacdrive.view.serving import LISTENING, Place

END_S = 1.0 + interrupts.END_S  # a page ends by itself within ``END_S``


@contextmanager
def started(place: Place, namespace: str, logs: Path) -> Iterator[ManagedProcess]:
    """Start the page as a separate command, which shares no modules with the robot's processes.

    Its process takes over the ``place``; its output goes to the folder ``logs``.
    """
    arguments = ['view', '--wait', '--port', str(place.port), '--namespace', namespace]
    environment = {LISTENING: str(place.inheritable())}
    command = 'delta3_pacdrive.cli.main'
    page = respawn(
        'view',
        command,
        arguments=arguments,
        log=logs / 'view.log',
        schedule=Schedule.ORDINARY,
        environment=environment,
    )
    page.patience_s = END_S
    place.close()
    try:
        yield page
    finally:
        if killed := end_all([page]):
            sys.stderr.write(f'note: {killed_sentence(killed)}\n')
