"""States in a bag in addition to cyclic telegrams: outputs, payload, inputs, fault, counters; by bus cycle."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.recording.bag_messages import OUTPUTS, PROGRESS
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.recording.signals import CELL_INPUTS, OUTPUT_COLUMNS
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.robot.sercos.telegrams import INPUTS_TOPIC

if TYPE_CHECKING:
    from delta3_pacdrive.numerics.types import Floats
    from delta3_pacdrive.recording.bag_messages import Sessions
    from delta3_pacdrive.recording.trace import Trace

WIDTH = len(OUTPUT_COLUMNS) + 1  # plus the payload
PAYLOAD = 'dynamics.payload_mass_kg'
COUNTERS = ('lost_telegrams', 'overruns')
CYCLE_MAX = 2**53


def read(trace: Trace) -> dict[str, Floats]:
    """Return the states in each bus cycle of the trace of a bag, shapes (cycles, columns).

    Outputs and payload apply from the bus cycle of their change, a fault from the cycle of its detection until a report
    without it. Counters are those of the latest report; reports are published five times per second. States are 0
    before the first message, and omitted if not recorded.
    """
    if trace.messages is None:
        return {}
    states = _States(float(trace.meta['cycle_time_s']), trace.messages.sessions)
    trace.messages.decode({OUTPUTS: states.outputs, INPUTS_TOPIC: states.inputs, PROGRESS: states.progress})
    cycles = np.rint(trace.time_s / float(trace.meta['cycle_time_s'])).astype(np.int64)
    parameters = trace.meta.get('parameters')
    payload = parameters.get(PAYLOAD, 0.0) if isinstance(parameters, dict) else 0.0
    return states.signals(cycles, payload)


class _States:
    """Collector of the state messages of a bag."""

    def __init__(self, period_s: float, sessions: Sessions) -> None:
        self._period_s, self._sessions = period_s, sessions
        self._switched: list[tuple[int, list[float]]] = []
        self._inputs: list[tuple[int, list[float]]] = []
        # cycle, session, cycle of the fault or -1, counters
        self._reports: list[tuple[int, str, int, list[float]]] = []

    def outputs(self, message: Any) -> None:
        """Add the outputs and the payload from a bus cycle on."""
        values = [float(value) for value in message.position]
        if len(values) == WIDTH and np.isfinite(values).all():
            stamp = message.header.stamp
            self._switched.append((self._cycle(stamp.sec + stamp.nanosec / NANOSECONDS), values))

    def inputs(self, message: Any) -> None:
        """Add the inputs of a bus cycle, unless they are unchanged."""
        values = [float(value) for value in message.position]
        if not 0 < len(values) <= CELL_INPUTS or not np.isfinite(values).all():
            return
        values += [0.0] * (CELL_INPUTS - len(values))
        if not self._inputs or self._inputs[-1][1] != values:
            stamp = message.header.stamp
            self._inputs.append((self._cycle(stamp.sec + stamp.nanosec / NANOSECONDS), values))

    def progress(self, message: Any) -> None:
        """Add a progress report."""
        report = MotionProgress.of_recording(message.data)
        counters = [float(getattr(report, name)) for name in COUNTERS]
        fault = report.fault_cycle if report.fault else -1
        self._reports.append((self._cycle(report.bus_time_s), report.session, fault, counters))

    def _cycle(self, time_s: float) -> int:
        cycle = round(time_s / self._period_s)
        if abs(cycle) > CYCLE_MAX:
            raise ValueError('not a bus time')
        return cycle

    def signals(self, cycles: Any, payload_kg: float) -> dict[str, Floats]:
        """Return the states in each of the bus cycles."""
        found: dict[str, Floats] = {}
        if self._switched:
            before = [0.0] * len(OUTPUT_COLUMNS) + [float(payload_kg)]
            values = _held(cycles, self._switched, before)
            found['payload'] = values[:, -1:].copy()
            found['outputs'] = values[:, :-1].copy()
        if self._inputs:
            found['cell_inputs'] = _held(cycles, self._inputs, [0.0] * CELL_INPUTS)
        reports = [report for report in self._reports if self._sessions.holds(report[1])]
        if reports:
            counted = [(cycle, counters) for cycle, _, _, counters in reports]
            values = _held(cycles, counted, [0.0] * len(COUNTERS))
            found |= {name: values[:, n : n + 1].copy() for n, name in enumerate(COUNTERS)}
            faults = [
                (cycle if fault < 0 else fault, [0.0 if fault < 0 else 1.0]) for cycle, _, fault, _ in reports
            ]
            found['fault'] = _held(cycles, faults, [0.0])
        return found


def _held(cycles: Any, changes: list[tuple[int, list[float]]], before: list[float]) -> Floats:
    """Return the values valid in bus cycles: those of the last change up to each cycle."""
    ordered = sorted(changes, key=lambda change: change[0])
    values = np.array([before, *(value for _, value in ordered)])
    return np.asarray(values[np.searchsorted([cycle for cycle, _ in ordered], cycles, side='right')])
