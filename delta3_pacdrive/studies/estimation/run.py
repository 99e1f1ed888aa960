"""Estimation study: reads or simulates measurements, fits models and writes the results; can be resumed."""

import json
import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ArmDeviations, Parameters
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.tables import column_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.recording.trace_file import load, save
from delta3_pacdrive.studies.estimation import (
    before_after,
    figures,
    fitted_file,
    report,
    thesis_setup,
)
from delta3_pacdrive.studies.estimation import missing_effects as missing
from delta3_pacdrive.studies.estimation.fitted_file import Fitted
from delta3_pacdrive.studies.estimation.identifiability import Z_95, Verdict
from delta3_pacdrive.studies.estimation.measurement import (
    completed,
    parts_of,
    sample_time_s,
    simulate,
    with_noise,
)
from delta3_pacdrive.studies.estimation.model_check import ModelCheck, check
from delta3_pacdrive.studies.estimation.models import GeometryModel, TorqueModel, WindingModel
from delta3_pacdrive.studies.estimation.problem import Model, Problem
from delta3_pacdrive.studies.estimation.quantities import (
    BUILT_EXCHANGE_S,
    GROUPS,
    OF_DRIVES,
    TABLE,
    Quantity,
    start_values,
    with_effects_of,
    with_values,
)
from delta3_pacdrive.studies.estimation.replay_model import ReplayModel
from delta3_pacdrive.studies.estimation.solver import Fit, Iterate, half_widths
from delta3_pacdrive.studies.estimation.study import Settings
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance, os_errors_as, write_json
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.framework.study import OnProgress
from delta3_pacdrive.studies.runs.inputs import is_recording, is_table, with_digests
from delta3_pacdrive.studies.runs.run_comparison import mismatches
from delta3_pacdrive.studies.runs.runs import notes_of

THESIS = 'thesis'
OTHER_GROUP = {'motor': 'masses', 'masses': 'motor'}  # that may differ instead
REMEDY = 'correct the file, or describe its columns with --columns'
TIMING = (
    'with one sample per bus cycle it is confounded with the sampling instant and the dead times of the current '
    'loops, which the log does not contain; phase_voltage would separate them'
)
OF_TIMING = ('R', 'L')  # confounded with the timing inside the drives in a third-party log
UNIT_NEAR = 0.05  # relative distance to the ratio of two units; robots differ as well
MUCH_WIDER = 1.5  # ratio of intervals at which a quantity depends on the settings of the drive
OWN_VERDICTS = (Verdict.IDENTIFIABLE, Verdict.WEAK)  # of a quantity on its own
# range of the timing of other drives in periods of the current loop: samples up to two earlier, dead time by one
TIMING_PERIODS = (-1.0, 3.0)
SETTINGS, ITERATE = 'session.json', 'iterate.json'


@dataclass
class Study(studies.Study):
    """Estimation study in a folder, which can be resumed from its last accepted iterate."""

    settings: Settings
    iterate: Iterate | None = None
    robot: Parameters = field(init=False)
    model_robot: Parameters = field(init=False)
    quantities: tuple[Quantity, ...] = field(init=False, default=())
    timing: tuple[str, ...] = field(init=False, default=())  # free, but not identifiable
    notes: list[str] = field(init=False, default_factory=list)  # on incomplete recordings

    def __post_init__(self) -> None:
        """Read the parameters and reject contradictory settings."""
        self.robot = self.model_robot = core.load(self.settings.parameters)
        traces = [is_recording(text) for text in self.settings.inputs]
        self._simulates, off = not any(traces), self.settings.start_off
        self._off = (0.3 if self._simulates else 0.0) if off is None else off
        if any(traces) and not all(traces):
            raise EstimationError('the inputs must all be traces, or one program')
        if not any(traces) and len(traces) > 1:
            raise EstimationError('only one program can be simulated as measurement')
        if any(is_recording(text) is self._simulates for text in self.settings.validate):
            kind = 'programs, as the input is' if self._simulates else 'recordings, as the inputs are'
            raise EstimationError(f'--validate takes {kind}')
        if self.settings.group == THESIS:
            if self.settings.free or self.settings.known:
                raise EstimationError('the group thesis has its own free quantities')
        else:
            if self.settings.group == 'geometry' and self.robot.kinematics.corrections != ArmDeviations():
                raise EstimationError(
                    f'the group geometry requires equal arms, but {self.settings.parameters} has corrections of '
                    'each arm (kinematics.*_correction_*): use delta3 calibrate fit to estimate them'
                )
            own = GROUPS[self.settings.group]
            self.quantities = own.chosen(self.settings.free, self.settings.known, self.robot)
            self.model_robot = with_effects_of(self.robot, self.quantities)

    def unfinished(self) -> str:
        """Return the message after an interrupt, with the command that continues."""
        if self.iterate is None:
            return 'interrupted before the first iteration'
        again = f'delta3 estimate --resume {shlex.quote(str(self.folder))}'
        return f'interrupted after iteration {self.iterate.number}; continue with {again}'

    @staticmethod
    def resumed(folder: Path, command: str, on_progress: OnProgress) -> 'Study':
        """Return the study that was begun in a folder, to continue from its last accepted iterate.

        Raises
        ------
        EstimationError
            No estimation was begun there, or its parameters or inputs have changed since.

        """
        document = _read_json(folder / SETTINGS, 'no estimation began in')
        try:
            values = document['settings']
            lists = {key: tuple(values[key]) for key in ('inputs', 'free', 'known', 'validate')}
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
        """Estimate, write all results and return the report; ``measurement`` is a file for the simulated trace.

        Raises
        ------
        Delta3Error
            Inputs cannot be read, or nothing can be estimated from them.

        """
        # read inputs first, so that an error leaves an earlier estimation unchanged
        origin = {'settings': asdict(self.settings), 'stamp': self._stamp(), 'command': self.command}
        if self.iterate is None:
            ReportFolder(self.folder, self._provenance()).clear([ITERATE])
        write_json(origin, self.folder / SETTINGS)
        if self.settings.group == THESIS:
            return self._run_thesis()
        traces = self.traces(self.settings.inputs, measurement)
        self.allow_for_timing(traces)
        self._require_matching_signals(traces)

        def build(robot: Parameters) -> list[Model]:
            return [model for trace in traces for model in self.models(trace, robot)]

        problem = Problem(self.quantities, build(self.model_robot), self.model_robot)
        start = start_values(self.quantities, self.model_robot, self._off)
        self._require_matching_currents(problem)
        if self.iterate is not None and len(self.iterate.x) != len(start):
            raise EstimationError(f'{self.folder / ITERATE} is damaged: it has {len(self.iterate.x)} values')
        found = missing.fit_built(problem, start, build, self._keep, self.iterate)
        found = found.without(self.reasons_of_timing(problem, found))
        found = found.without(self.reasons_of_settings(problem, found), Verdict.NUISANCE)
        aside = [
            model
            for trace in self.traces(self.settings.validate)
            for model in self.models(trace, self.model_robot)
        ]
        verdict = check(problem, found, aside)
        other = '' if verdict.holds else self._other_group(traces)
        better = None if verdict.holds or other else self._search(traces, found)
        document = report.fit_summary(found, problem, self.robot, self._simulates)
        document = report.judged(document, verdict, better, self.robot, self._simulates)
        document['other_group'] = other
        if verdict.holds:
            document['verdict'] += self.dependence_on_settings(problem, found)
        document |= {'notes': self.notes} if self.notes else {}
        self.on_progress('tables and figures', 0, 0)
        folder = ReportFolder(self.folder, self._provenance())
        tables = report.fit_tables(document, found, problem)
        drawings = figures.of_fit(found, problem, document['estimates'])
        if self.settings.apply:
            before = self._with(start, self.model_robot if better is None else self.robot)
            fitted = self._fitted(problem, found, verdict, better)
            document['applied'], more = self._apply(traces, folder, before, fitted)
            drawings |= more
        title = f'Estimation: {self.settings.group}'
        return folder.results(title, document, report.text(document), tables, drawings)

    def allow_for_timing(self, traces: Sequence[Trace]) -> None:
        """Free the timing inside the drives for logs that were not recorded by this package.

        Such a log contains neither the instant within a bus cycle at which the current is sampled nor the dead time of
        the current loops; both are confounded with inertia and inductance. The arms are coupled in every period of the
        current loop, as in reality.
        """
        group = GROUPS[self.settings.group]
        if self._simulates or all({'parameters', 'checksum'} & trace.meta.keys() for trace in traces):
            return
        held = {*group.named(self.settings.known), *(quantity.symbol for quantity in self.quantities)}
        if 't_I' not in group.possible or any('phase_voltage' in trace.signals for trace in traces):
            return
        more = (*OF_TIMING, *OF_DRIVES)
        self.quantities += tuple(TABLE[symbol] for symbol in more if symbol not in held)
        self.timing = tuple(symbol for symbol in more if symbol not in self.settings.free)
        self.model_robot = self.model_robot.replace(bus__exchange_period_s=BUILT_EXCHANGE_S)

    def reasons_of_timing(self, problem: Problem, found: Fit) -> dict[str, str]:
        """Return why each timing quantity is not identifiable, with its interval over the possible instants."""
        early, late = (n * self.robot.drive.current_period_s for n in TIMING_PERIODS)
        reasons = {symbol: TIMING for symbol in self.timing if symbol in OF_TIMING}
        for symbol, (low, high) in found.spans(problem, 't_I', early, late).items():
            if symbol in reasons:
                interval = f'{max(low, 0.0):.3g} to {high:.3g} {TABLE[symbol].unit}'
                reasons[symbol] += f'; {interval} if these differ by {1e6 * early:.4g} to {1e6 * late:.4g} us'
        return reasons

    def reasons_of_settings(self, problem: Problem, found: Fit) -> dict[str, str]:
        """Return prior and fitted value of each nuisance parameter of the drives."""
        reasons = {}
        means = start_values(self.quantities, self.model_robot, 0.0)
        for quantity, mean, estimate in zip(self.quantities, means, found.estimates, strict=False):
            if quantity.symbol in self.timing and quantity.prior:
                half = Z_95 * quantity.prior * quantity.extent(mean)
                reasons[quantity.symbol] = (
                    f'{mean:.3g} +- {half:.2g} {quantity.unit} (95 %) assumed; '
                    f'{estimate.value:.3g} +- {estimate.half_width:.2g} fitted'
                )
        return reasons

    def dependence_on_settings(self, problem: Problem, found: Fit) -> list[str]:
        """Return a sentence on quantities whose intervals would be much narrower with known settings of the drives."""
        columns = list(found.identifiability.estimated)
        symbols = [self.quantities[j].symbol for j in columns]
        kept = [k for k, symbol in enumerate(symbols) if symbol not in self.timing]
        if len(kept) == len(columns) or not kept:
            return []
        known = [columns[k] for k in kept]
        free, fixed = (
            half_widths(problem, found.x, own, found.residuals, found.whiteness) for own in (columns, known)
        )
        affected = [
            f'{symbols[k]} (+-{100.0 * free[k]:.2g} %, with known settings +-{100.0 * width:.2g} %)'
            for k, width in zip(kept, fixed, strict=True)
            if free[k] > MUCH_WIDER * width and found.identifiability.verdict(symbols[k]) in OWN_VERDICTS
        ]
        if not affected:
            return []
        advice = 'currents averaged over each bus cycle (--method balance)'
        if self.robot.drive.interpolation == 'linear':
            advice = f'cubic set points (drive.interpolation: cubic) or {advice}'
        return [
            f'dependent on sampling instant, delays and gains of the drive: {", ".join(affected)}; a log with {advice} '
            'depends less on them'
        ]

    def _require_matching_signals(self, traces: Sequence[Trace]) -> None:
        """Raise EstimationError if positions or speeds of a log have other axes, signs or units than its commands."""
        for trace in traces if not self._simulates else ():
            signals = trace.signals
            if {'motor_command', 'motor_position'} <= signals.keys():
                self._require_match('motor_position', signals['motor_command'], signals['motor_position'])
            if {'motor_position', 'motor_speed'} <= signals.keys() and len(trace.time_s) > 1:
                speed = np.gradient(signals['motor_position'], sample_time_s(trace), axis=0)
                self._require_match('motor_speed', speed, signals['motor_speed'])

    def _require_matching_currents(self, problem: Problem) -> None:
        """Raise EstimationError if the currents have other axes, signs or units than those of the parameter file."""
        values = problem.values(start_values(self.quantities, self.model_robot, 0.0))
        for model in problem.models if not self._simulates else ():
            if isinstance(model, ReplayModel | TorqueModel):
                modelled = model.measured - model.residuals(values)[0]
                self._require_match('current', modelled, model.measured)

    def _require_match(self, name: str, one: Floats, other: Floats) -> None:
        ratio = self.robot.dynamics.gear_ratio
        found = mismatches(name, one, other, ratio, ('the model', 'the log'), near=UNIT_NEAR)
        # ratios without a known cause are differences of the robots
        if wrong := [text for text in found if 'times' not in text or ', as ' in text]:
            raise EstimationError(f'{"; ".join(wrong)}: {REMEDY}')

    def _run_thesis(self) -> dict[str, Any]:
        chosen = self.settings
        if self._simulates:
            program = programs.load(chosen.inputs[0], self.robot.motion)
            exact = simulate(program, self.robot, 'bus')
            trace = with_noise(exact, self.robot, chosen.noise, chosen.seed)
            other = self.robot.replace(rich__enabled=True, bus__exchange_period_s=BUILT_EXCHANGE_S)
            built = simulate(program, other, 'bus')
        else:
            if len(chosen.inputs) != 1:
                raise EstimationError('the group thesis takes one trace')
            (trace, *more), built = self.traces(chosen.inputs), None
            if more:
                raise EstimationError('the group thesis takes one trace without gaps')
        study = thesis_setup.study(
            trace,
            self.robot,
            self._off,
            on_progress=self.on_progress,
            on_iterate=self._keep,
            resume=self.iterate,
            built=built,
        )
        found, problem = study.cure, study.problem
        document = report.fit_summary(found, problem, self.robot, self._simulates)
        document = report.judged(document, check(problem, found), None, self.robot, self._simulates)
        document |= report.thesis_summary(study)
        self.on_progress('tables and figures', 0, 0)
        folder = ReportFolder(self.folder, self._provenance())
        tables = report.fit_tables(document, found, problem) + report.thesis_tables(study)
        drawings = figures.of_thesis(study) | figures.of_fit(found, problem, document['estimates'])
        return folder.results('Estimation: thesis', document, report.text(document), tables, drawings)

    def _other_group(self, traces: Sequence[Trace]) -> str:
        """Return the group of motors or masses whose quantities explain a third-party log; empty if none does."""
        name = OTHER_GROUP.get(self.settings.group, '')
        if not name or not self.timing:
            return ''
        self.on_progress(f'the model does not explain the data; fitting the group {name}', 0, 0)
        chosen = replace(self.settings, group=name, free=(), known=())
        study = Study(chosen, self.folder, self.command, self.on_progress)
        study.allow_for_timing(traces)

        def build(robot: Parameters) -> list[Model]:
            return [model for trace in traces for model in study.models(trace, robot)]

        problem = Problem(study.quantities, build(study.model_robot), study.model_robot)
        found = missing.fit_built(problem, start_values(study.quantities, study.model_robot, 0.0), build)
        return name if check(problem, found).holds else ''

    def _search(self, traces: Sequence[Trace], found: Fit) -> missing.BetterModel | None:
        """Search for missing effects if the signals allow it."""
        group = GROUPS[self.settings.group]
        if group.name != 'geometry' and not all(self._can_replay(trace) for trace in traces):
            return None

        def build(robot: Parameters) -> list[Model]:
            return [model for trace in traces for model in self.models(trace, robot, 'replay')]

        first = self.quantities, found.x
        return missing.search(
            group, build, self.model_robot, first, known=self.settings.known, on_progress=self.on_progress
        )

    def _can_replay(self, trace: Trace) -> bool:
        coarse = abs(sample_time_s(trace) - self.robot.bus.cycle_time_s) < 1e-3 * self.robot.bus.cycle_time_s
        return coarse and 'motor_command' in trace.signals

    def _with(self, x: Floats, robot: Parameters, held: Sequence[str] = ()) -> Parameters:
        """Return a robot with values of the free quantities, except for ``held`` ones."""
        values = zip(self.quantities, x.tolist(), strict=True)
        return with_values(robot, {q.symbol: value for q, value in values if q.symbol not in held})

    def _fitted(
        self, problem: Problem, found: Fit, verdict: ModelCheck, better: missing.BetterModel | None
    ) -> Fitted:
        """Return the parameters to write: those of the better model if there is one."""
        if better is not None:
            sentences = [*better.check.sentences, better.sentence]
            return Fitted(better.robot, better.problem, better.fit, better.check.holds, sentences)
        after = self._with(found.x, self.model_robot, self.timing)
        if self.timing:
            after = after.replace(bus__exchange_period_s=self.robot.bus.exchange_period_s)
        return Fitted(after, problem, found, verdict.holds, verdict.sentences)

    def _apply(
        self, traces: Sequence[Trace], folder: ReportFolder, before: Parameters, fitted: Fitted
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Write the parameter file; return its summary and the drawing functions of its figures."""
        source = f'from {", ".join(self.settings.inputs)}'
        path = fitted_file.write(folder.path / fitted_file.NAME, fitted, source, self._provenance())
        folder.add(path)
        document: dict[str, Any] = {'file': str(path), 'model_holds': fitted.holds, 'before_after': []}
        drawings: dict[str, Any] = {}
        if self._simulates and self.settings.group != 'geometry':
            program = programs.load(self.settings.inputs[0], self.robot.motion)
            traces = [simulate(program, self.robot, 'bus')]
        for trace in traces:
            if self._can_replay(trace):
                apart = before_after.compare(trace, before, fitted.parameters)
                row = {
                    'input': trace.meta.get('input', self.settings.inputs[0]),
                    'rms': apart.rms(),
                    'text': before_after.sentences(apart),
                }
                document['before_after'].append(row)
                drawings = drawings or before_after.drawings(apart)
        return document, drawings

    def models(self, trace: Trace, robot: Parameters, method: str = '') -> list[Model]:
        """Return the models of a robot for which a trace contains the signals.

        Raises
        ------
        EstimationError, TraceError
            Required signals are missing.

        """
        ratio = trace.meta.get('gear_ratio', self.robot.dynamics.gear_ratio)
        if ratio != self.robot.dynamics.gear_ratio:
            raise EstimationError(
                f'the trace is of a robot with gear ratio {ratio:g}, '
                f'that of the parameters is {self.robot.dynamics.gear_ratio:g}'
            )
        models = self._fitting(trace, robot, method or self.settings.method)
        loudness = max(1.0, self.settings.noise, float(trace.meta.get('noise', 0.0)))
        for model in models:
            model.blocks = tuple(replace(b, sigma=loudness * b.sigma) for b in model.blocks)
        return models

    def _fitting(self, trace: Trace, robot: Parameters, method: str) -> list[Any]:
        if self.settings.group == 'geometry':
            if 'tcp_measured' not in trace.signals:
                raise EstimationError(
                    'the trace has no tcp_measured: the geometry cannot be estimated from arm angles alone, '
                    'because with three angles and three degrees of freedom every geometry closes'
                )
            return [GeometryModel(trace, robot)]
        models: list[Any] = []
        electrical = WindingModel.depends.intersection(q.symbol for q in self.quantities)
        if electrical and 'phase_voltage' in trace.signals:
            models.append(WindingModel(trace, robot))
        coarse = sample_time_s(trace) > 0.5 * self.robot.bus.cycle_time_s
        if method == 'auto':
            method = 'replay' if coarse else 'balance'
            if coarse and 'motor_command' not in trace.signals:
                raise EstimationError(
                    'currents sampled once per bus cycle contain the ripple of the set points in a fixed phase: '
                    'the trace needs motor_command for a replay, or faster samples '
                    '(or --method balance, if the samples are means)'
                )
        models.append((ReplayModel if method == 'replay' else TorqueModel)(trace, robot))
        return models

    def _provenance(self) -> Provenance:
        chosen = self.settings
        seed = chosen.seed if self._simulates else None
        return Provenance.of(self.command, self.robot, chosen.parameters, with_digests(chosen.inputs), seed)

    def traces(self, inputs: Sequence[str], measurement: Path | None = None) -> list[Trace]:
        """Read recordings, or simulate the measurement of programs; raises Delta3Error."""
        settings = self.settings
        if not self._simulates:
            self.on_progress('reading', 0, 0)
            found: list[Trace] = []
            for text in inputs:
                columns = column_file.read(settings.columns) if settings.columns and is_table(text) else None
                trace, notes = load(text, columns, gaps=True), list[str]()
                if settings.group == 'geometry':
                    parts = [completed(trace, self.robot)]
                else:
                    parts, notes = parts_of(trace, self.robot, text, settings.method != 'balance')
                found += [Trace(one.time_s, one.signals, one.meta | {'input': text}) for one in parts]
                self.notes += [f'{text}: {note}' for note in (*notes_of(parts[0]), *notes)]
            return found
        sampling = settings.sampling
        if settings.group == 'geometry' or (sampling == 'auto' and self.robot.rich.enabled):
            sampling = 'bus'
        traces = []
        for number, text in enumerate(inputs):
            program = programs.load(text, self.robot.motion)
            exact = simulate(program, self.robot, sampling, self.on_progress)
            traces.append(with_noise(exact, self.robot, settings.noise, settings.seed + number))
        if measurement is not None:
            save(traces[0], measurement)
        return traces

    def _keep(self, iterate: Iterate) -> None:
        """Write an accepted iterate for resuming."""
        self.iterate = iterate
        document = {'iteration': iterate.number, 'values': iterate.x.tolist(), 'cost': iterate.cost}
        write_json(document, self.folder / ITERATE)
        self.on_progress(f'iteration {iterate.number}, cost {iterate.cost:.4g}', 0, 0)

    def _stamp(self) -> str:
        digests = [note.rpartition(' ')[2] for note in with_digests(self.settings.inputs)]
        return ' '.join([self.robot.checksum, *digests])


def _read_json(path: Path, what: str) -> Any:
    try:
        with os_errors_as(f'{what} {path.parent}', EstimationError):
            return json.loads(path.read_text(encoding='utf-8'))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise EstimationError(f'{path} is damaged: {error}') from error
