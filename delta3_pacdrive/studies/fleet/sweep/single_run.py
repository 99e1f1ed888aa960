"""A single run of a sweep: parameters and program from a row of values, and the row of its results."""

import math
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np

from delta3_pacdrive import simulation
from delta3_pacdrive.control.cycle.transformation import Figures
from delta3_pacdrive.errors import Delta3Error, SweepError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import UNSHAPED, Motion, Parameters, flatten, from_flat
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.recording.signals import OF_DRIVES, REQUESTED_SIGNALS
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.fleet.sweep.program_values import with_value
from delta3_pacdrive.studies.fleet.sweep.study import FUNCTION, PROGRAM, Kept, Outcome, Reduction, Sweep

PROGRAM_S = 'program_s'
PLANS_MAX = 64  # cached plans per process
# name prefixes of parameters on which plans do not depend, unless moves are shaped for the robot; and exceptions
UNPLANNED = (
    'rich.',
    'drive.',
    'control.',
    'motor.brake_apply_s',
    'motor.brake_release_s',
    'motor.brake_torque_n_m',
    'motor.coupling_effect',
    'motor.load_',
    'motor.pole_pairs',
    'motor.winding_inductance_h',
    'dynamics.arm_coupling',
    'dynamics.end_stop_',
)
PLANNED = ('drive.torque_limit_n_m', 'drive.dc_link_voltage_v', 'drive.position_period_s')
Row = dict[str, Any]


class Runner:
    """Makes the runs of a sweep in one process.

    A program is planned anew only if its plan depends on a changed value.

    Parameters
    ----------
    sweep
        The sweep.

    Attributes
    ----------
    planning_s
        Processor time for planning.

    """

    def __init__(self, sweep: Sweep) -> None:
        self._sweep = sweep
        self.planning_s = 0.0
        self._base = from_flat(dict(sweep.parameters))
        self._parsed: tuple[Any, Motion, Program] | None = None  # last document, motion parameters, program
        self._plans: OrderedDict[str, program_planner.Planned] = OrderedDict()
        self._function = function_of(sweep.function)

    def run(self, number: int, values: Mapping[str, Any]) -> Row:
        """Make a run; errors are reported in its row."""
        row: Row = {'run': number, 'outcome': Outcome.DONE, 'reason': ''}
        try:
            parameters, program = self.made(values)
            trace = self.traced(parameters, program, tuple(self._signals()))
            if trace.meta['stopped']:
                row |= {'outcome': Outcome.STOPPED, 'reason': trace.meta['stopped']}
            row |= self.numbers(trace)
        except SweepError:
            raise  # invalid definition of results: no run can be made
        except Delta3Error as error:
            row |= {'outcome': Outcome.REFUSED, 'reason': str(error)}
        return row

    def made(self, values: Mapping[str, Any]) -> tuple[Parameters, Program]:
        """Return parameters and program of a run; raises Delta3Error."""
        changed: dict[str, Any] = {}
        for key, value in values.items():
            plain = value.item() if isinstance(value, np.generic) else value
            if key.startswith(PROGRAM):
                continue
            name, bracket, rest = key.partition('[')
            if bracket:
                several = list(changed.get(name, self._sweep.parameters[name]))
                several[int(rest.removesuffix(']'))] = plain
                changed[name] = several
            else:
                changed[name] = plain
        parameters = self._base.replaced(changed)
        return parameters, self._program(self.document(values), parameters.motion)

    def document(self, values: Mapping[str, Any]) -> Any:
        """Return the document of the program of a run."""
        document: Any = self._sweep.program
        for key, value in values.items():
            if key.startswith(PROGRAM):
                plain = value.item() if isinstance(value, np.generic) else value
                document = with_value(document, key.removeprefix(PROGRAM), plain)
        return document

    def _program(self, document: Any, motion: Motion) -> Program:
        if self._parsed is None or self._parsed[0] is not document or self._parsed[1] != motion:
            program = program_file.parse(document, motion, self._sweep.program_name)
            self._parsed = document, motion, program
        return self._parsed[2]

    def traced(self, parameters: Parameters, program: Program, signals: Sequence[str] = ()) -> Trace:
        """Return the trace of a run; raises Delta3Error."""

        def planner(program: Program, place: Floats, robot: Parameters) -> program_planner.Planned:
            key = plan_key(program, place, robot)
            if key not in self._plans:
                started = time.process_time()
                self._plans[key] = program_planner.plan(program, place, robot)
                self.planning_s += time.process_time() - started
                if len(self._plans) > PLANS_MAX:
                    self._plans.popitem(last=False)
            self._plans.move_to_end(key)
            return self._plans[key]

        return simulation.run(program, parameters, signals=signals, planner=planner)

    def numbers(self, trace: Trace) -> dict[str, float]:
        """Return the results of a trace; raises Delta3Error."""
        figures = figures_of(trace)
        found = figures if not self._sweep.keep else {}
        for one in self._sweep.keep:
            found[one.name] = figures[one.name] if one.name in figures else reduced(trace, one)
        if self._function is not None:
            found |= own_numbers(self._function, trace)
        return found

    def _signals(self) -> set[str]:
        """Return the required signals that are recorded on request only."""
        named = {name for one in self._sweep.keep for name in (one.signal, one.less) if name}
        return {name for name in named if name in REQUESTED_SIGNALS or name.startswith(OF_DRIVES)}


def figure_names() -> list[str]:
    """Return the names of the figures of a run; a robot with a rotary axis has more."""
    found = []
    for one in fields(Figures):
        if one.name == 'turns':
            continue
        several = str(one.type).startswith('list')
        found += [f'{one.name}_{n}' for n in (1, 2, 3)] if several else [one.name]
    return [*found, PROGRAM_S]


@cache
def is_planned(name: str) -> bool:
    """Whether plans depend on a parameter, if moves are not shaped."""
    return name in PLANNED or not name.startswith(UNPLANNED)


def plan_key(program: Program, place: Floats, robot: Parameters) -> str:
    """Return a text that is equal for runs with bit-identical plans."""
    everything = robot.control.shaping != UNSHAPED
    values = [value for name, value in flatten(robot).items() if everything or is_planned(name)]
    return repr((program, np.asarray(place).tobytes(), everything, values))


def figures_of(trace: Trace) -> dict[str, float]:
    """Return the figures of a trace as single numbers; those of axes, or of x, y, z, are numbered."""
    found: dict[str, float] = {}
    for name, value in trace.meta['figures'].items():
        if isinstance(value, (list, tuple)):
            found |= {f'{name}_{n}': _float(one) for n, one in enumerate(value, start=1)}
        else:
            found[name] = _float(value)
    found[PROGRAM_S] = _float(trace.meta[PROGRAM_S])
    return found


def _float(value: Any) -> float:
    return math.nan if value is None else float(value)


def reduced(trace: Trace, kept: Kept) -> float:
    """Return the reduction of a signal to a number.

    Raises
    ------
    SweepError
        The figure, the signal, or that part of it does not exist.

    """
    if not kept.signal:
        raise SweepError(f'there is no figure {shown(kept.name)}: figures are {", ".join(figures_of(trace))}')
    for name in filter(None, (kept.signal, kept.less)):
        if name not in trace.signals:
            raise SweepError(f'{kept.name}: a run contains no signal {name}')
    values = trace[kept.signal]
    if kept.less:
        values = values - trace[kept.less]
    begin = trace.meta['start_cycle']
    time_s = trace.time_s - begin * trace.meta['cycle_time_s']
    values = values[(time_s >= kept.from_s) & (time_s <= kept.to_s)]
    if kept.axis > values.shape[1]:
        raise SweepError(f'{kept.name}: axis is {kept.axis}, but {kept.signal} has {values.shape[1]} columns')
    if not len(values):
        raise SweepError(f'{kept.name}: there is no sample from {kept.from_s:g} to {kept.to_s:g} s')
    if kept.axis:
        column = values[:, kept.axis - 1]
    elif kept.signal.startswith('tcp_'):
        column = np.linalg.norm(values, axis=1)
    else:
        column = values if kept.reduction is not Reduction.FINAL else values[:, 0]
    return _number(column, kept.reduction)


def _number(values: Floats, reduction: Reduction) -> float:
    match reduction:
        case Reduction.MAX:
            return float(np.abs(values).max())
        case Reduction.RMS:
            return float(np.sqrt(np.mean(np.square(values))))
        case Reduction.MEAN:
            return float(np.mean(values))
        case Reduction.MIN:
            return float(np.min(values))
        case Reduction.FINAL:
            return float(np.ravel(values)[-1])


def function_of(source: str) -> Callable[[Trace], Mapping[str, float]] | None:
    """Return the function ``figures`` of a source text; None for an empty text."""
    if not source:
        return None
    names: dict[str, Any] = {'__name__': 'sweep_function'}
    try:
        exec(compile(source, 'function of the sweep', 'exec'), names)  # noqa: S102 (the operator has named it)
    except Exception as error:
        raise SweepError(
            f'the function of the sweep cannot be read: {type(error).__name__}: {error}'
        ) from error
    if not callable(names.get(FUNCTION)):
        raise SweepError(f'the file of the function does not define {FUNCTION}')
    function: Callable[[Trace], Mapping[str, float]] = names[FUNCTION]
    return function


def own_numbers(function: Callable[[Trace], Mapping[str, float]], trace: Trace) -> dict[str, float]:
    """Return the results of a user function for a trace; raises SweepError."""
    try:
        return {str(name): float(value) for name, value in function(trace).items()}
    except Exception as error:
        raise SweepError(f'{FUNCTION} of the sweep: {type(error).__name__}: {error}') from error
