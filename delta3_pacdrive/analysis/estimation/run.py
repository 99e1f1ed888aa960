"""One estimation from its settings to its folder: what is measured, which models fit it, where it can go on."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.analysis import figure_style
from delta3_pacdrive.analysis.estimation import figures, report, thesis_setup
from delta3_pacdrive.analysis.estimation.geometry_model import GeometryModel
from delta3_pacdrive.analysis.estimation.measurement import sample_time_s, simulate, with_noise
from delta3_pacdrive.analysis.estimation.motor_models import TorqueModel, WindingModel
from delta3_pacdrive.analysis.estimation.problem import Problem
from delta3_pacdrive.analysis.estimation.quantities import GROUPS, start_values
from delta3_pacdrive.analysis.estimation.replay_model import ReplayModel
from delta3_pacdrive.analysis.estimation.solver import Iterate, fit
from delta3_pacdrive.analysis.provenance import Provenance, digest, write_json
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.motion import program as programs
from delta3_pacdrive.recording.bag_trace import load, save

if TYPE_CHECKING:
    from collections.abc import Callable

    from delta3_pacdrive.analysis.estimation.problem import Model
    from delta3_pacdrive.analysis.estimation.quantities import Quantity
    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.recording.trace import Trace

    OnProgress = Callable[[str, int, int], None]

THESIS = 'thesis'
GROUP_NAMES = (*GROUPS, THESIS)
METHODS = ('auto', 'balance', 'replay')
SAMPLINGS = ('drive', 'bus')
SETTINGS, ITERATE, REPORT = 'session.json', 'iterate.json', 'report.json'


@dataclass(frozen=True)
class Settings:
    """What an estimation depends on, apart from the contents of its files.

    Attributes
    ----------
    group
        One of ``GROUP_NAMES``.
    inputs
        Traces (.npz, .csv, folders of bags), or one program to be simulated as measurement.
    parameters
        Parameter file; None: the packaged one.
    sampling
        Of a simulated measurement: 'drive' or 'bus'.
    method
        For the mechanical part: 'balance' of torques, 'replay' of the closed loop, or what fits the sampling.
    noise, seed
        Of a simulated measurement: multiple of typical sensor noise, and its seed.
    start_off
        Share by which the estimation starts beside the values of the parameter file; None: 0.3 for a simulated
        measurement, 0 for a trace.
    free, known
        Symbols that are freed, or held, beside what the group does by itself.

    """

    group: str
    inputs: tuple[str, ...] = ('excitation',)
    parameters: str | None = None
    sampling: str = 'drive'
    method: str = 'auto'
    noise: float = 0.0
    seed: int = 0
    start_off: float | None = None
    free: tuple[str, ...] = ()
    known: tuple[str, ...] = ()

    @property
    def off(self) -> float:
        """Share by which the estimation starts beside the parameter file."""
        if self.start_off is not None:
            return self.start_off
        return 0.3 if self.simulates else 0.0

    @property
    def simulates(self) -> bool:
        """Whether the measurement is simulated."""
        return not any(is_trace(text) for text in self.inputs)


def is_trace(text: str) -> bool:
    """Whether an input is a trace: a folder, or a file that is no program."""
    path = Path(text)
    return path.is_dir() or path.suffix.lower() in ('.npz', '.csv')


@dataclass
class Study:
    """An estimation in a folder.

    ``on_progress`` is called with a stage in words, what is done and all of it (0: not known).
    """

    settings: Settings
    folder: Path
    command: str
    on_progress: OnProgress
    iterate: Iterate | None = None
    robot: Parameters = field(init=False)
    quantities: tuple[Quantity, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        """Read the parameters and refuse settings that contradict one another."""
        self.robot = core.load(self.settings.parameters)
        traces = [is_trace(text) for text in self.settings.inputs]
        if any(traces) and not all(traces):
            raise EstimationError('the inputs must all be traces, or one program')
        if not any(traces) and len(traces) > 1:
            raise EstimationError('only one program can be simulated as measurement')
        if self.settings.group == THESIS:
            if any(traces):
                raise EstimationError('the group thesis simulates its measurement: name a program, no trace')
            if self.settings.free or self.settings.known:
                raise EstimationError('the group thesis has its own free quantities')
        else:
            self.quantities = GROUPS[self.settings.group].chosen(self.settings.free, self.settings.known)

    @staticmethod
    def resumed(folder: Path, command: str, on_progress: OnProgress) -> Study:
        """Return the session that began in a folder, to go on from its last accepted iterate.

        Raises
        ------
        EstimationError
            No estimation began there, or its parameters or inputs have changed since.

        """
        document = _read_json(folder / SETTINGS, 'no estimation began in')
        try:
            values = document['settings']
            lists = {key: tuple(values[key]) for key in ('inputs', 'free', 'known')}
            settings = Settings(**(values | lists))
            stamp = document['stamp']
        except (AttributeError, KeyError, TypeError) as error:
            raise EstimationError(f'{folder / SETTINGS} is damaged: {error}') from error
        session = Study(settings, folder, command, on_progress)
        if session._stamp() != stamp:
            raise EstimationError(f'parameters or inputs have changed since the estimation in {folder} began')
        if (folder / ITERATE).exists():
            found = _read_json(folder / ITERATE, 'no iterate in')
            try:
                x = np.array(found['values'], dtype=np.float64)
                session.iterate = Iterate(int(found['iteration']), x, float(found['cost']))
            except (KeyError, TypeError, ValueError) as error:
                raise EstimationError(f'{folder / ITERATE} is damaged: {error}') from error
        return session

    def run(self, measurement: Path | None = None) -> dict[str, Any]:
        """Estimate, write everything into the folder and return the report; a simulated trace goes to a file as well.

        Raises
        ------
        Delta3Error
            Inputs cannot be read, or hold nothing that can be estimated.

        """
        # inputs are read first: one that cannot be read leaves an earlier estimation as it is
        origin = {'settings': asdict(self.settings), 'stamp': self._stamp(), 'command': self.command}
        if self.iterate is None:
            (self.folder / ITERATE).unlink(missing_ok=True)
        write_json(origin, self.folder / SETTINGS)
        if self.settings.group == THESIS:
            return self._run_thesis()
        traces = self._traces(measurement)
        quantities = self.quantities
        models = [model for trace in traces for model in self.models(trace)]
        problem = Problem(quantities, models, self.robot)
        start = start_values(quantities, self.robot, self.settings.off)
        if self.iterate is not None and len(self.iterate.x) != len(start):
            raise EstimationError(f'{self.folder / ITERATE} is damaged: it has {len(self.iterate.x)} values')
        found = fit(problem, start, self._keep, self.iterate)
        provenance = self.provenance()
        document = report.fit_document(found, problem, self.robot, self.settings.simulates, provenance)
        self.on_progress('tables and figures', 0, 0)
        tables = report.write_fit_tables(document, found, problem, self.folder, provenance)
        drawings = {
            'estimates.png': partial(figures.estimates, document['estimates'], provenance),
            'sensitivities.png': partial(figures.sensitivities, found, problem, provenance),
            'residuals.png': partial(figures.residuals, found, problem, provenance),
        }
        return self._finish(document, tables, drawings)

    def _run_thesis(self) -> dict[str, Any]:
        settings = self.settings
        program = programs.load(settings.inputs[0], self.robot.motion)
        found = thesis_setup.study(
            program,
            self.robot,
            settings.off,
            settings.noise,
            settings.seed,
            self.on_progress,
            self._keep,
            self.iterate,
        )
        provenance = self.provenance()
        cure = report.fit_document(found.cure, found.problem, self.robot, True, provenance)
        document = report.study_document(found, cure)
        tables = report.write_fit_tables(cure, found.cure, found.problem, self.folder, provenance)
        tables += report.write_study_tables(found, self.folder, provenance)
        drawings = {
            'quotients.png': partial(figures.quotients, found, provenance),
            'attempts.png': partial(figures.attempts, found, provenance),
            'estimates.png': partial(figures.estimates, cure['estimates'], provenance),
            'sensitivities.png': partial(figures.sensitivities, found.cure, found.problem, provenance),
            'residuals.png': partial(figures.residuals, found.cure, found.problem, provenance),
        }
        return self._finish(document, tables, drawings)

    def _finish(self, document: dict[str, Any], tables: list[Path], drawings: Any) -> dict[str, Any]:
        pictures = figure_style.save(drawings, self.folder, self.provenance().lines())
        document['files'] = [str(path) for path in (self.folder / REPORT, *tables, *pictures)]
        write_json(document, self.folder / REPORT)
        return document

    def models(self, trace: Trace) -> list[Model]:
        """Return the models that a trace of the group has the signals for.

        Raises
        ------
        EstimationError, TraceError
            Signals are missing; says which, and why they are needed.

        """
        ratio = trace.meta.get('gear_ratio', self.robot.dynamics.gear_ratio)
        if ratio != self.robot.dynamics.gear_ratio:
            raise EstimationError(
                f'the trace is of a robot with gear ratio {ratio:g}, '
                f'the parameters say {self.robot.dynamics.gear_ratio:g}'
            )
        if self.settings.group == 'geometry':
            if 'tcp_measured' not in trace.signals:
                raise EstimationError(
                    'the trace has no tcp_measured: arm angles alone show no geometry, '
                    'for with three angles and three freedoms every geometry closes'
                )
            return [GeometryModel(trace, self.robot)]
        models: list[Model] = []
        electrical = WindingModel.depends.intersection(q.symbol for q in self.quantities)
        if electrical and 'phase_voltage' in trace.signals:
            models.append(WindingModel(trace, self.robot))
        coarse = sample_time_s(trace) > 0.5 * self.robot.bus.cycle_time_s
        method = self.settings.method
        if method == 'auto':
            method = 'replay' if coarse else 'balance'
            if coarse and 'motor_command' not in trace.signals:
                raise EstimationError(
                    'currents that are sampled once per bus cycle catch the ripple of the set points in one phase: '
                    'the trace needs motor_command for a replay, or faster samples '
                    '(or --method balance, if the samples are means)'
                )
        return [
            *models,
            ReplayModel(trace, self.robot) if method == 'replay' else TorqueModel(trace, self.robot),
        ]

    def provenance(self) -> Provenance:
        """Return how the outputs come about."""
        settings = self.settings
        inputs = [f'{text} {found}' for text, found in zip(settings.inputs, self._digests(), strict=True)]
        seed = settings.seed if settings.simulates else None
        return Provenance.of(self.command, self.robot, settings.parameters, inputs, seed)

    def _traces(self, measurement: Path | None) -> list[Trace]:
        settings = self.settings
        if not settings.simulates:
            self.on_progress('reading', 0, 0)
            return [load(text) for text in settings.inputs]
        program = programs.load(settings.inputs[0], self.robot.motion)
        sampling = 'bus' if settings.group == 'geometry' else settings.sampling
        exact = simulate(
            program, self.robot, sampling, lambda done, total: self.on_progress('measurement', done, total)
        )
        trace = with_noise(exact, self.robot, settings.noise, settings.seed)
        if measurement is not None:
            save(trace, measurement)
        return [trace]

    def _keep(self, iterate: Iterate) -> None:
        """Write an accepted iterate, so that the estimation can go on from it."""
        self.iterate = iterate
        document = {'iteration': iterate.number, 'values': iterate.x.tolist(), 'cost': iterate.cost}
        write_json(document, self.folder / ITERATE)
        self.on_progress(f'iteration {iterate.number}, cost {iterate.cost:.4g}', 0, 0)

    def _digests(self) -> list[str]:
        return [
            digest(Path(text) if is_trace(text) else programs.find(text)) for text in self.settings.inputs
        ]

    def _stamp(self) -> str:
        return ' '.join([self.robot.checksum, *self._digests()])


def _read_json(path: Path, what: str) -> Any:
    try:
        return json.loads(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise EstimationError(f'{what} {path.parent}: {error.strerror or error}') from error
    except ValueError as error:
        raise EstimationError(f'{path} is damaged: {error}') from error
