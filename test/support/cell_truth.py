"""The true states of the cell of a simulation by bus cycle, and the expected reports of a robot on the bus."""

import json
from contextlib import contextmanager

import numpy as np
import pytest

import belts
import delta3_pacdrive as d3
from bags import CLOCK, JOINT_STATE, META, STORE, TYPES, message, numbers, record
from delta3_pacdrive import scripting
from delta3_pacdrive.cell import world

TEXT = 'std_msgs/msg/String'
CELL_TYPES = {'cell/scene': TEXT, 'cell/parts': TEXT, 'sercos/at/belts': JOINT_STATE}


class Truth:
    """Where the simulation has each part, with the TCP, and the messages of the plant: topic and bytes."""

    def __init__(self):
        self.cycles, self.arrivals, self.made = {}, [], []

    def note(self, around, cycle, tcp_m):
        """Record a bus cycle after its step."""
        at = {part.record.number: (part.at_m, part.angle_rad) for part in self.made}
        self.cycles[cycle] = tuple(map(float, tcp_m)), at
        if around.changed:
            parts = [one.to_document() for one in around.changed]
            told = {'cycle': cycle, **around.about(), 'parts': parts, 'misses': []}
            self.arrivals.append(('cell/parts', text(told)))
        if around.belts:
            counts = {name: state.count for name, state in around.belts.items()}
            self.arrivals.append(('sercos/at/belts', counted(cycle, counts)))
        self.scene = around.scene


def text(told):
    """Return the bytes of a message with a JSON object, or with a text."""
    words = told if isinstance(told, str) else json.dumps(told)
    return bytes(STORE.serialize_cdr(STORE.types[TEXT](words), TEXT))


def counted(cycle, counts, session='3fa9'):
    """Return the bytes of a message with the counts of belts."""
    types = STORE.types
    header = types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](*CLOCK.stamp(cycle)), session)
    values = np.array(list(counts.values()), float)
    whole = types[JOINT_STATE](header, list(counts), values, np.zeros(len(values)), np.empty(0))
    return bytes(STORE.serialize_cdr(whole, JOINT_STATE))


@contextmanager
def witnessed():
    """Record the cells of simulations meanwhile."""
    truth, step = Truth(), world.World.step

    class NotedPart(world.Part):
        def __init__(self, *given, **named):
            super().__init__(*given, **named)
            truth.made.append(self)

    def noted(around, cycle, tcp_m, outputs, turn_rad):
        inputs = step(around, cycle, tcp_m, outputs, turn_rad)
        truth.note(around, cycle, tcp_m)
        return inputs

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(world, 'Part', NotedPart)
        patch.setattr(world.World, 'step', noted)
        yield truth


def packaging():
    """Simulate the packaging program in its cell; return trace and truth."""
    with witnessed() as truth:
        return d3.simulate('packaging', cell='cell'), truth


def picks_from_a_belt(**of_belt):
    """Simulate a script that takes two of three parts from a belt; return trace and truth."""
    with (
        witnessed() as truth,
        scripting.simulate('model', cell=belts.around([belts.speed_of(0.5)], 3, **of_belt)) as robot,
    ):
        for _ in range(2):
            belts.pick(robot)
        robot.dwell(3.0)  # the third one leaves the belt
    return robot.trace, truth


def bag_of(folder, arrivals, scene, cycles, more_types=()):
    """Write a bag with messages of a cell in some bus cycles; its values of the robot are arbitrary."""
    whole = [('cell/scene', text(scene)), *arrivals]
    whole += [(t, message(t, CLOCK.stamp(k), numbers(t, k % 8))) for k in cycles for t in TYPES]
    return record(folder, whole, META, types=TYPES | CELL_TYPES | dict(more_types))
