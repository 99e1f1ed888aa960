"""Faults that tests inject: one of each kind, and a program during which they occur."""

from delta3_pacdrive import simulation
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.robot.faults.fault import KINDS, Target

HOME = [0.0, 0.0, -0.78]
LINE = {'start_m': HOME, 'moves': [{'move_l': {'to_m': [0.2, 0.0, -0.78], 'speed_m_s': 0.4}}]}


def example(kind):
    """Return a document of a kind with everything that it may have."""
    row = KINDS[kind]
    document = {'fault': kind, 'after_s': 0.25}
    if row.target == Target.AXIS:
        document['axis'] = 'axis2'
    elif row.target == Target.NODE:
        document['node'] = 'plant'
    if row.value:
        document[row.value] = row.high
    if row.telegram:
        document['cycles'] = 3
    elif not row.once:
        document['for_s'] = 0.5
    return document


def run(robot, *faults):
    document = LINE | {'faults': list(faults)}
    return simulation.run(programs.parse(document, robot.motion), robot)
