"""Experiment study: runs model and robot on one program and compares them; also compares any two runs."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from delta3_pacdrive import parameters as core
from delta3_pacdrive import simulation
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance, digest, os_errors_as
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.framework.study import OnProgress
from delta3_pacdrive.studies.runs import runs
from delta3_pacdrive.studies.runs.alignment import BY_START
from delta3_pacdrive.studies.runs.run_comparison import compare
from delta3_pacdrive.studies.runs.runs import named
from delta3_pacdrive.studies.thesis.experiments import attribution, figures, report
from delta3_pacdrive.studies.thesis.experiments.claims import ArmSpeeds
from delta3_pacdrive.studies.thesis.experiments.compared_signals import Run
from delta3_pacdrive.studies.thesis.experiments.comparison import Comparison
from delta3_pacdrive.studies.thesis.experiments.study import Pair, Results, Settings

LAST = 3  # last experiment: 11.1.3 compares its arm speeds with those of the others
FILES = {'model': 'model.yaml', 'robot': 'robot.yaml'}  # their parameters

SEED_LIMIT = 2**31  # of rich.sensor_seed

Graph = Callable[
    [Path, Mapping[str, Path], Mapping[str, Trace], OnProgress], tuple[dict[str, Trace], list[str]]
]
"""Runs a program file on robots, given as parameter files and simulations by name; returns traces and notes."""


@dataclass
class Study(studies.Study):
    """Experiment study in a folder; with a ``graph`` both robots run as ROS nodes."""

    settings: Settings
    graph: Graph | None = None
    robots: dict[str, core.Parameters] = field(init=False)

    def __post_init__(self) -> None:
        """Read the parameters and the program; raises Delta3Error."""
        chosen = self.settings
        self.robots = {'model': core.load(chosen.parameters), 'robot': core.load(chosen.robot)}
        self._notes = []
        if chosen.seed is not None:
            self.robots['robot'] = self.robots['robot'].replace(rich__sensor_seed=chosen.seed)
            if not self.robots['robot'].rich.effects.sensors:
                self._notes.append('the robot has no sensor noise, so --seed changes nothing')
        # the packaged program, not a folder of that name in the working directory
        self._path = core.config_directory() / 'programs' / f'experiment{chosen.number}.yaml'
        self._make_cycles_alike()
        self._program = programs.load(self._path, self.robots['model'].motion)

    def run(self) -> dict[str, Any]:
        """Run both robots, write all results and return the report; raises Delta3Error."""
        number = self.settings.number
        folder = ReportFolder(self.folder, self._provenance())
        folder.clear([*report.TABLES, *figures.file_names(number)])
        files = self._write_parameters()
        self.on_progress('simulation', 0, 0)
        model, robot = self.robots.values()
        simulated = {who: simulation.run(self._program, own) for who, own in self.robots.items()}
        traces = simulated
        if self.graph is not None:
            recorded, notes = self.graph(self._path, files, simulated, self.on_progress)
            self._notes += notes
            # a recording does not contain the end of the program
            ends = {who: {'end_cycle': trace.meta['end_cycle']} for who, trace in simulated.items()}
            traces = {who: Trace(t.time_s, t.signals, t.meta | ends[who]) for who, t in recorded.items()}
        comparison = Comparison.of(Run.of(traces['model'], model), Run.of(traces['robot'], robot))
        explained = None
        if self.settings.attributed:
            run = Run.of(simulated['model'], model)
            explained = attribution.attribute(self._program, run, model, robot, self.on_progress)
        elsewhere = self._arm_speeds_elsewhere(robot) if number == LAST else {}
        seeded = self._with_other_seeds(Run.of(simulated['model'], model))
        found = Results(
            number, self._program.name, comparison, explained, self._notes, elsewhere=elsewhere, seeded=seeded
        )
        self.on_progress('tables and figures', 0, 0)
        for path in files.values():
            folder.add(path)
        return _write(folder, found)

    def _make_cycles_alike(self) -> None:
        """Run the packaged model with the robot's bus cycle; a specified model keeps its own."""
        cycle_s = {who: robot.bus.cycle_time_s for who, robot in self.robots.items()}
        if cycle_s['model'] == cycle_s['robot']:
            return
        if self.settings.parameters is None:
            self.robots['model'] = self.robots['model'].replace(bus__cycle_time_s=cycle_s['robot'])
            self._notes.append(
                f'the model runs with the bus cycle of the robot, {1e3 * cycle_s["robot"]:g} ms'
            )
            return
        self._notes.append(
            f'the bus cycles are {1e3 * cycle_s["model"]:g} ms of the model and {1e3 * cycle_s["robot"]:g} ms of the '
            f'robot: both are compared every {1e3 * max(cycle_s.values()):g} ms'
        )

    def _with_other_seeds(self, model: Run) -> list[tuple[Comparison, dict[int, ArmSpeeds]]]:
        """Return the simulated comparison, and the other experiments, for further seeds of the robot."""
        robot, number = self.robots['robot'], self.settings.number
        if not robot.rich.effects.sensors:
            return []
        found = []
        for count in range(self.settings.seeds):
            self.on_progress('other seeds', count, self.settings.seeds)
            own = robot.replace(rich__sensor_seed=(robot.rich.sensor_seed + 1 + count) % SEED_LIMIT)
            run = Run.of(simulation.run(self._program, own), own)
            elsewhere = self._arm_speeds_elsewhere(own) if number == LAST else {}
            found.append((Comparison.of(model, run), elsewhere))
        return found

    def _arm_speeds_elsewhere(self, robot: core.Parameters) -> dict[int, ArmSpeeds]:
        """Simulate the earlier experiments and return their arm speeds."""
        found = {}
        for number in range(1, LAST):
            path = self._path.with_stem(f'experiment{number}')
            model, other = (
                Run.of(simulation.run(programs.load(path, own.motion), own), own)
                for own in (self.robots['model'], robot)
            )
            found[number] = ArmSpeeds.of(Comparison.of(model, other))
        return found

    def _provenance(self) -> Provenance:
        chosen, robot = self.settings, self.robots['robot']
        seed = robot.rich.sensor_seed if robot.rich.effects.sensors else None
        inputs = [f'{self._path.stem} {digest(self._path)}']
        origin = Provenance.of(self.command, self.robots['model'], chosen.parameters, inputs, seed)
        both = f'model {origin.parameters}, robot {robot.checksum} ({chosen.robot})'
        return replace(origin, parameters=both)

    def _write_parameters(self) -> dict[str, Path]:
        with os_errors_as(f'cannot write to {self.folder}'):
            self.folder.mkdir(parents=True, exist_ok=True)
            return {who: core.write(robot, self.folder / FILES[who]) for who, robot in self.robots.items()}


@dataclass
class PairStudy(studies.Study):
    """Compares any two runs like an experiment."""

    settings: Pair

    def run(self) -> dict[str, Any]:
        """Compare, write all results and return the report; raises Delta3Error."""
        pair = self.settings
        folder = ReportFolder(self.folder, self._provenance())
        folder.clear([*report.TABLES, *figures.file_names(None)])
        self.on_progress('comparison', 0, 0)
        found = compared(pair, self.on_progress)
        self.on_progress('tables and figures', 0, 0)
        return _write(folder, found)

    def _provenance(self) -> Provenance:
        model, robot = self.settings.model, self.settings.robot
        origin = Provenance.of(
            self.command, model.robot, model.parameter_source, [model.origin, robot.origin]
        )
        of_robot = f'{robot.robot.checksum} ({robot.parameter_source or core.DEFAULT_FILE})'
        return replace(origin, parameters=f'model {origin.parameters}, robot {of_robot}')


def compared(pair: Pair, on_progress: OnProgress = studies.silent) -> Results:
    """Compare any two runs, and attribute the difference if both are simulated.

    Raises
    ------
    TraceError
        The runs cannot be aligned, or have no signal or no time in common.

    """
    model, robot = pair.model, pair.robot
    found = compare(model, robot, pair.how)
    aligned = found.alignment
    robot = aligned.clocked(robot)
    comparison = Comparison.of(
        Run.of_part(model.window, model.robot), Run.of_part(robot.window, robot.robot), aligned.shift_s
    )
    names = named([model, robot])
    notes = [
        f'{name}: {text}' for name, run in zip(names, (model, robot), strict=True) for text in _notes_of(run)
    ]
    notes += found.doubts
    if not math.isclose(model.period_s, robot.period_s):
        notes.append(
            f'{names[0]} has a value every {1e3 * model.period_s:.6g} ms, {names[1]} every '
            f'{1e3 * robot.period_s:.6g} ms: both are compared every {1e3 * comparison.model.period_s:.6g} ms'
        )
    explained = None
    if pair.attributed:
        why_not = _unexplained(pair, aligned.by)
        if why_not is None and model.program is not None:
            own = Run.of_part(model.window, model.robot)
            explained = attribution.attribute(model.program, own, model.robot, robot.robot, on_progress)
        else:
            notes.append(f'the difference is not attributed to effects: {why_not}')
    return Results(
        number=None,
        program=f'{names[0]} as the model, {names[1]} as the robot',
        comparison=comparison,
        attribution=explained,
        notes=notes,
        alignment=aligned,
    )


def _notes_of(run: runs.Run) -> list[str]:
    return [*run.notes, run.robot_note] if run.robot_note else list(run.notes)


def _unexplained(pair: Pair, by: str) -> str | None:
    """Return why the difference cannot be attributed; None if it can."""
    model, robot = pair.model, pair.robot
    if model.program is None or robot.program is None:
        return 'both runs must be programs, which can be simulated with each effect alone'
    if model.program != robot.program:
        return 'the programs are not the same'
    if by != BY_START:
        return 'the runs are not aligned by the start of their programs'
    return None if attribution.effects_of(robot.robot) else 'the robot has none of the effects'


def _write(folder: ReportFolder, found: Results) -> dict[str, Any]:
    """Write the results of a comparison and return the report; raises Delta3Error."""
    document, drawings = report.summary(found), figures.by_name(found)
    text, tables = report.text(document), report.tables(found)
    return folder.results(f'{found.title}: model and robot', document, text, tables, drawings)
