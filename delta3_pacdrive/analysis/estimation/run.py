"""One estimation from its settings to its folder: what is measured, which models fit it, where it can go on."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.analysis import study as studies
from delta3_pacdrive.analysis.estimation import figures, report, thesis_setup
from delta3_pacdrive.analysis.estimation.geometry_model import GeometryModel
from delta3_pacdrive.analysis.estimation.measurement import sample_time_s, simulate, with_noise
from delta3_pacdrive.analysis.estimation.motor_models import TorqueModel, WindingModel
from delta3_pacdrive.analysis.estimation.problem import Model, Problem
from delta3_pacdrive.analysis.estimation.quantities import GROUPS, Quantity, start_values
from delta3_pacdrive.analysis.estimation.replay_model import ReplayModel
from delta3_pacdrive.analysis.estimation.solver import Iterate, fit
from delta3_pacdrive.analysis.estimation.study import Settings
from delta3_pacdrive.analysis.inputs import is_recording, noted
from delta3_pacdrive.analysis.provenance import Provenance, excused, write_json
from delta3_pacdrive.analysis.report_folder import ReportFolder
from delta3_pacdrive.analysis.study import OnProgress
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.recording.trace_file import load, save

THESIS = 'thesis'
SETTINGS, ITERATE = 'session.json', 'iterate.json'


@dataclass
class Study(studies.Study):
    """An estimation in a folder, which can go on from its last accepted iterate."""

    settings: Settings
    iterate: Iterate | None = None
    robot: Parameters = field(init=False)
    quantities: tuple[Quantity, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        """Read the parameters and refuse settings that contradict one another."""
        self.robot = core.load(self.settings.parameters)
        traces = [is_recording(text) for text in self.settings.inputs]
        self._simulates, off = not any(traces), self.settings.start_off
        self._off = (0.3 if self._simulates else 0.0) if off is None else off
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
    def resumed(folder: Path, command: str, on_progress: OnProgress) -> 'Study':
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
            ReportFolder(self.folder, self._provenance()).clear([ITERATE])
        write_json(origin, self.folder / SETTINGS)
        if self.settings.group == THESIS:
            chosen, program = self.settings, programs.load(self.settings.inputs[0], self.robot.motion)
            wanted = self.robot, self._off, chosen.noise, chosen.seed
            study = thesis_setup.study(program, *wanted, self.on_progress, self._keep, self.iterate)
            found, problem = study.cure, study.problem
        else:
            models = [model for trace in self._traces(measurement) for model in self.models(trace)]
            study, problem = None, Problem(self.quantities, models, self.robot)
            start = start_values(self.quantities, self.robot, self._off)
            if self.iterate is not None and len(self.iterate.x) != len(start):
                told = f'{self.folder / ITERATE} is damaged: it has {len(self.iterate.x)} values'
                raise EstimationError(told)
            found = fit(problem, start, self._keep, self.iterate)
        folder = ReportFolder(self.folder, self._provenance())
        document = report.fit_summary(found, problem, self.robot, self._simulates)
        self.on_progress('tables and figures', 0, 0)
        tables = report.fit_tables(document, found, problem)
        drawings = figures.of_fit(found, problem, document['estimates'])
        if study is not None:
            document |= report.thesis_summary(study)
            tables += report.thesis_tables(study)
            drawings = figures.of_thesis(study) | drawings
        title = f'Estimation: {self.settings.group}'
        return folder.results(title, document, report.text(document), tables, drawings)

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
        models.append((ReplayModel if method == 'replay' else TorqueModel)(trace, self.robot))
        return models

    def _provenance(self) -> Provenance:
        chosen = self.settings
        seed = chosen.seed if self._simulates else None
        return Provenance.of(self.command, self.robot, chosen.parameters, noted(chosen.inputs), seed)

    def _traces(self, measurement: Path | None) -> list[Trace]:
        settings = self.settings
        if not self._simulates:
            self.on_progress('reading', 0, 0)
            return [load(text) for text in settings.inputs]
        program = programs.load(settings.inputs[0], self.robot.motion)
        sampling = 'bus' if settings.group == 'geometry' else settings.sampling
        exact = simulate(program, self.robot, sampling, self.on_progress)
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

    def _stamp(self) -> str:
        digests = [note.rpartition(' ')[2] for note in noted(self.settings.inputs)]
        return ' '.join([self.robot.checksum, *digests])


def _read_json(path: Path, what: str) -> Any:
    try:
        with excused(f'{what} {path.parent}', EstimationError):
            return json.loads(path.read_text(encoding='utf-8'))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise EstimationError(f'{path} is damaged: {error}') from error
