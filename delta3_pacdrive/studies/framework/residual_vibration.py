"""Residual vibration of the true TCP after a stop: measured in a trace, and predicted for each move."""

import math
from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive import simulation
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import EXCHANGE_PERIODS_S, UNSHAPED, Parameters, from_flat
from delta3_pacdrive.planning.paths.move import Move
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.planned_move import plan_dwell
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework.study import OnProgress, silent

SETTLED_S = 0.15  # after the end of a move, when the built robot has come to rest
ARRIVES_S = 3e-3  # delay from the last set point to the motors; one bus cycle more with ``sercos2``
STANDS_S = 0.35  # dwell after a move that is simulated separately


def after_stop(trace: Trace, cycle: int) -> Floats:
    """Return the true TCP [m] relative to its rest position, from the arrival of the last set point on; shape (n, 3).

    ``cycle`` is the bus cycle of the last set point.

    Raises
    ------
    TraceError
        The robot is not at rest long enough, or the true TCP is not recorded.

    """
    period = float(trace.time_s[1] - trace.time_s[0])
    if 'tcp_true' not in trace.signals:
        raise TraceError('the true TCP is unknown: only a simulation contains it')
    late_cycles = from_flat(trace.meta['parameters']).bus_delay_cycles - 1
    first, last = cycle + round(ARRIVES_S / period) + late_cycles, cycle + round(SETTLED_S / period)
    if not 0 < first < last < len(trace.time_s):
        raise TraceError(f'the robot must be at rest for {SETTLED_S:g} s after bus cycle {cycle}')
    tcp = trace['tcp_true']
    return np.asarray(tcp[first:last] - tcp[last : last + last - first].mean(axis=0))


def swing_m(beside_m: Floats) -> float:
    """Return the largest distance between two consecutive turning points of a coordinate [m], of shape (n, 3).

    Monotonic creep is not a swing.
    """
    swings = [0.0]
    for one in beside_m.T:
        turns = np.flatnonzero(np.diff(np.sign(np.diff(one))) != 0.0) + 1
        ends = one[np.concatenate([turns, [len(one) - 1]])]
        swings.append(float(np.abs(np.diff(ends)).max(initial=0.0)))
    return max(swings)


@dataclass(frozen=True)
class Swing:
    """Predicted swing of the true TCP after a shaped move, and after the same move without shaping [m]."""

    number: int
    name: str
    swing_m: float
    unshaped_m: float

    @property
    def less_db(self) -> float | None:
        """Reduction of the swing by shaping [dB]; None if nothing swings."""
        if self.swing_m == 0.0 or self.unshaped_m == 0.0:
            return None
        return 20.0 * math.log10(self.unshaped_m / self.swing_m)

    @property
    def text(self) -> str:
        """The prediction as a sentence."""
        less = '' if self.less_db is None else f', {self.less_db:.1f} dB less'
        return (
            f'move {self.number}: the TCP swings by {1e3 * self.swing_m:.3f} mm after it, instead of '
            f'{1e3 * self.unshaped_m:.3f} mm without shaping{less}'
        )


def predicted_swings(
    program: Program,
    planned: Planned,
    parameters: Parameters,
    on_progress: OnProgress = silent,
) -> list[Swing]:
    """Predict the swing after each shaped move of the first round by simulating it alone on the built robot.

    The effects of the built robot are switched on for the prediction. ``on_progress`` receives the stage and the
    numbers
    of completed and of all moves.
    """
    built = parameters
    if not built.rich.enabled:
        built = built.replace(rich__enabled=True, bus__exchange_period_s=min(EXCHANGE_PERIODS_S))
    plain = built.replace(control__shaping=UNSHAPED)
    others = simulation.plan_of(program, simulation.placed(plain, program))
    first = dict.fromkeys(planned.plan.tables.order[: planned.first_round].tolist())
    swings = []
    for done, number in enumerate(first):
        shaped, unshaped = planned.plan.moves[number], others.plan.moves[number]
        if shaped.master.tobytes() == unshaped.master.tobytes():
            continue
        on_progress('vibration', done, len(first))
        swings.append(
            Swing(
                planned.plan.tables.order.tolist().index(number) + 1,
                planned.names[number],
                swing_after(shaped, program, planned, built),
                swing_after(unshaped, program, planned, plain),
            )
        )
    return swings


def swing_after(move: Move, program: Program, planned: Planned, built: Parameters) -> float:
    """Return the swing [m] of a ``built`` robot after a ``move`` of a ``planned`` ``program``, executed alone."""
    end_m, payload_kg = move.end_m(), move.payload_kg
    for event in move.events:
        payload_kg = event[3] if event[3] >= 0.0 else payload_kg
    stands = plan_dwell(end_m, STANDS_S, payload_kg, 'dwell', built).move.with_turns(move.end_turns_rad)
    alone = replace(planned, plan=Plan.of([move, stands]), repeat=1)
    x, y, z = move.start_m().tolist()
    placed = replace(program, start_m=(x, y, z), start_turns_rad=move.start_turns_rad, faults=())
    trace = simulation.run(placed, built, planner=lambda *_: alone)
    return swing_m(after_stop(trace, trace.meta['end_cycle'] - round(STANDS_S / built.bus.cycle_time_s)))
