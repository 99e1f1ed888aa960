"""The page of a robot that is brought up, in a process that is started before anything of the robot is loaded.

People wait for the first picture, and what the page and a browser load takes longer than the robot needs to be there.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from delta3_pacdrive import interrupts
from delta3_pacdrive.bringup.processes import ManagedProcess, end_all, killed_sentence, respawn
from delta3_pacdrive.bringup.scheduling import Schedule
from delta3_pacdrive.view.serving import LISTENING, Place

END_S = 1.0 + interrupts.END_S  # a page that can ends itself before


@contextmanager
def started(place: Place, namespace: str, logs: Path) -> Iterator[ManagedProcess]:
    """Start the page as a command of its own, so that nothing of it is loaded into the robot's processes.

    Parameters
    ----------
    place
        Where it is served; the process has it from here on.
    namespace
        Of the robot.
    logs
        Folder for what it prints.

    """
    arguments = ['view', '--wait', '--port', str(place.port), '--namespace', namespace]
    environment = {LISTENING: str(place.inheritable())}
    command = 'delta3_pacdrive.cli.main'
    page = respawn('view', command, arguments, logs / 'view.log', Schedule.ORDINARY, environment)
    page.patience_s = END_S
    place.close()
    try:
        yield page
    finally:
        if killed := end_all([page]):
            sys.stderr.write(f'note: {killed_sentence(killed)}\n')
