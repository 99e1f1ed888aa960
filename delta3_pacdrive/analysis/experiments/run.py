"""An experiment from its settings to its folder: a model and a robot run one program, and are compared."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from delta3_pacdrive import parameters as core
from delta3_pacdrive import simulation
from delta3_pacdrive.analysis import study as studies
from delta3_pacdrive.analysis.experiments import attribution, figures, report
from delta3_pacdrive.analysis.experiments.comparison import Comparison, Run
from delta3_pacdrive.analysis.experiments.study import Results, Settings
from delta3_pacdrive.analysis.provenance import Provenance, digest, excused
from delta3_pacdrive.analysis.report_folder import ReportFolder
from delta3_pacdrive.analysis.study import OnProgress
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.recording.trace import Trace

FILES = {'model': 'model.yaml', 'robot': 'robot.yaml'}  # their parameters

Graph = Callable[
    [Path, Mapping[str, Path], Mapping[str, Trace], OnProgress], tuple[dict[str, Trace], list[str]]
]
"""Runs a program (file) on robots (parameter files, by name) whose simulations are known; returns traces and notes."""


@dataclass
class Study(studies.Study):
    """The study is an experiment in a folder; with a ``graph`` both robots run as nodes, which are compared."""

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
        # a folder of that name in the working directory is not meant
        self._path = core.config_directory() / 'programs' / f'experiment{chosen.number}.yaml'
        self._program = programs.load(self._path, self.robots['model'].motion)

    def run(self) -> dict[str, Any]:
        """Run both robots, write everything into the folder and return the report; raises Delta3Error."""
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
            # a recorder ends without knowing when the program ended
            ends = {who: {'end_cycle': trace.meta['end_cycle']} for who, trace in simulated.items()}
            traces = {who: Trace(t.time_s, t.signals, t.meta | ends[who]) for who, t in recorded.items()}
        comparison = Comparison.of(Run.of(traces['model'], model), Run.of(traces['robot'], robot))
        explained = None
        if self.settings.attributed:
            run = Run.of(simulated['model'], model)
            explained = attribution.attribute(self._program, run, model, robot, self.on_progress)
        found = Results(number, self._program.name, comparison, explained, self._notes)
        self.on_progress('tables and figures', 0, 0)
        for path in files.values():
            folder.add(path)
        document, drawings = report.summary(found), figures.by_name(found)
        text, tables = report.text(document), report.tables(found)
        return folder.results(f'Experiment {number}: model and robot', document, text, tables, drawings)

    def _provenance(self) -> Provenance:
        chosen, robot = self.settings, self.robots['robot']
        seed = robot.rich.sensor_seed if robot.rich.effects.sensors else None
        inputs = [f'{self._path.stem} {digest(self._path)}']
        origin = Provenance.of(self.command, self.robots['model'], chosen.parameters, inputs, seed)
        both = f'model {origin.parameters}, robot {robot.checksum} ({chosen.robot})'
        return replace(origin, parameters=both)

    def _write_parameters(self) -> dict[str, Path]:
        with excused(f'cannot write to {self.folder}'):
            self.folder.mkdir(parents=True, exist_ok=True)
            return {who: core.write(robot, self.folder / FILES[who]) for who, robot in self.robots.items()}
