"""A calibration: poses are planned, measured by somebody or in simulation, and what they tell becomes parameters."""

import dataclasses
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.analysis import study as studies
from delta3_pacdrive.analysis.calibration import (
    estimation,
    figures,
    measurement_file,
    model,
    planning,
    report,
    simulated,
)
from delta3_pacdrive.analysis.calibration.data import Left, Measurements, Method, Poses
from delta3_pacdrive.analysis.calibration.study import Found, Settings
from delta3_pacdrive.analysis.inputs import noted
from delta3_pacdrive.analysis.provenance import Provenance, os_errors_as
from delta3_pacdrive.analysis.report_folder import ReportFolder
from delta3_pacdrive.errors import CalibrationError
from delta3_pacdrive.motion.program_file import parse
from delta3_pacdrive.motion.program_planner import plan as plan_program
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

POSES, PROGRAM, MEASURED, CALIBRATED = 'poses.csv', 'poses.yaml', 'measurements.csv', 'calibrated.yaml'
TRIED = 40  # poses of a simulated robot to look at the truth, neither used nor for checks
TOUCHES = (Method.PLANE, Method.BALL, Method.LEVEL)
NOT_GEOMETRY = 'what is no geometry, as gears that give under weight: left without any noise'
BACKLASH = 'backlash of the gears, wherever the weight changes the flank'


@dataclass
class Study(studies.Study):
    """A calibration leaves poses and a program to be measured, or what measurements tell."""

    settings: Settings

    def __post_init__(self) -> None:
        """Read the parameters of the controller, and those of the robot that is simulated; raises ParameterError."""
        s = self.settings
        machine = None if s.simulate is None else core.load(s.simulate)
        own = core.load(s.parameters) if s.parameters is not None or machine is None else machine
        self.robot: Parameters = (
            own if machine is None else dataclasses.replace(machine, kinematics=own.kinematics)
        )

    def plan(self) -> dict[str, Any]:
        """Plan measuring poses; write them as a table and as a program; return the summary."""
        poses = self._planned()
        folder = self._folder(())
        folder.clear((POSES, PROGRAM))
        angles = simulated.planned_angles(poses, self.robot)
        folder.add(measurement_file.write(folder.path / POSES, poses, angles, folder.provenance))
        document = simulated.program(poses, f'{len(poses.points_m)} poses of a calibration')
        folder.add(report.write_program(folder.path / PROGRAM, document, folder.provenance))
        folder.figures({'poses.png': partial(figures.plan_of, poses, self.robot)}, with_foot=True)
        told = report.plan_document(poses, self.settings.wanted)
        return folder.summary('Poses of a calibration', told, report.plan_text(told))

    def fit(self, path: Path | None) -> dict[str, Any]:
        """Estimate from a file of measurements, or from simulated ones; return the summary."""
        folder = self._folder(() if path is None else (str(path),))
        found, calibrated = self.found(path)
        folder.clear((CALIBRATED, *report.TABLES, *figures.NAMES))
        if path is None:
            folder.add(self._write_measured(folder, found.measurements))
        with os_errors_as(f'cannot write {folder.path / CALIBRATED}'):
            folder.make()
            head = report.head(found, folder.provenance)
            folder.add(core.write(calibrated, folder.path / CALIBRATED, head))
        document = report.document(found, self.settings.wanted, folder.path / CALIBRATED)
        drawings = figures.by_name(found, self.robot)
        return folder.results(
            'A calibration', document, report.text(document), report.tables(found), drawings
        )

    def found(self, path: Path | None = None) -> tuple[Found, Parameters]:
        """Estimate as ``fit`` does; return what was found, and the parameters that know it. Nothing is written."""
        measured = self._measured_poses() if path is None else self._read(path)
        self.on_progress('estimating', 0, 0)
        estimated = self._estimated(measured)
        calibrated = self._calibrated(estimated)
        left = list(estimation.compared(estimated, self._observation(measured)))
        limits = [('measuring noise, and what the poses do not tell', estimated.expected_m[1])]
        if self.settings.simulate is not None:
            left += self._truly(calibrated)
            limits += self._limits()
        return self._found(estimated, measured, left, limits), calibrated

    def _folder(self, inputs: tuple[str, ...]) -> ReportFolder:
        s = self.settings
        source = s.parameters or s.simulate
        origin = Provenance.of(
            self.command, self.robot, source, noted(inputs), s.seed if s.simulate else None
        )
        return ReportFolder(self.folder, origin)

    def _planned(self) -> Poses:
        self.on_progress('planning poses', 0, 0)
        poses = planning.plan(self.settings.wanted, self.robot)
        program = parse(simulated.program(poses, 'calibration'), self.robot.motion)
        plan_program(program, self.robot.motion.home_m, self.robot)  # refuses what the robot cannot drive
        return poses

    def _measured_poses(self) -> Measurements:
        """Plan poses and measure them in simulation."""
        poses, s = self._planned(), self.settings
        self.on_progress('measuring', 0, 0)
        return self._measure(poses, s.wanted.noise_m)

    def _measure(self, poses: Poses, noise_m: float) -> Measurements:
        s = self.settings
        if poses.objects:
            return simulated.touches(poses, self.robot, noise_m, s.seed, s.wanted.height_m)
        return simulated.points(poses, self.robot, s.wanted.method, noise_m, s.seed)

    def _read(self, path: Path) -> Measurements:
        measured = measurement_file.read(path, self.settings.columns)
        if measured.checksum not in ('', 'none', self.robot.checksum):
            raise CalibrationError(
                f'{path} tells angles of a controller with other parameters ({measured.checksum}, here '
                f'{self.robot.checksum}): give its parameter file with --parameters'
            )
        method = self.settings.wanted.method
        if not measured.objects and method in TOUCHES:
            raise CalibrationError(
                f'{path} has points of an instrument, not touches: it is for --method base or frame'
            )
        if measured.objects and method not in TOUCHES:  # what it is stands in the table
            method = Method.PLANE if np.isnan(measured.diameters_m).all() else Method.BALL
            wanted = dataclasses.replace(self.settings.wanted, method=method)
            self.settings = dataclasses.replace(self.settings, wanted=wanted)
        return measured

    def _observation(self, measured: Measurements) -> model.Observation:
        s = self.settings
        if s.wanted.method == Method.LEVEL:
            return model.Touches(measured, self.robot, True, s.wanted.height_m)
        if measured.objects:
            return model.Touches(measured, self.robot)
        kind = model.PointsInFrame if s.wanted.method == Method.FRAME else model.PointsInBase
        return kind(measured, self.robot)

    def _estimated(self, measured: Measurements) -> estimation.Estimate:
        s = self.settings
        return estimation.estimate(
            self._observation(measured),
            s.wanted.noise_m,
            planning.free_of(s.wanted),
            s.wanted.method in planning.PLACED,
        )

    def _calibrated(self, estimated: estimation.Estimate) -> Parameters:
        corrections = model.document_of(estimated.x)
        return self.robot.replace(**{f'kinematics__{name}': value for name, value in corrections.items()})

    def _truly(self, calibrated: Parameters) -> list[Left]:
        """Return how far the true TCP of the simulated robot is from where it is commanded to be."""
        self.on_progress('looking at the truth', 0, 0)
        what = 'true TCP' if self.settings.wanted.method in planning.PLACED else 'true TCP, its shape,'
        groups = (
            (f'{what} where weight presses the gears', self._places(True)),
            (f'{what} all over the workspace', self._places(False)),
        )
        return [
            estimation.left_of(what, *(self._off(group[:TRIED], one) for one in (self.robot, calibrated)))
            for what, group in groups
        ]

    def _places(self, are_pressed: bool) -> Floats:
        """Return places that nobody has measured; only those where the weight presses the gears, or all."""
        random = np.random.default_rng(self.settings.seed + 1)
        places = random.permutation(estimation.workspace(self.robot, estimation.FINE))
        return np.asarray(places[planning.pressed(places, self.robot)] if are_pressed else places)

    def _off(self, places: Floats, robot: Parameters) -> Floats:
        poses = simulated.scattered(places, [True] * len(places))
        off = simulated.standing(poses, robot)[1] - places
        if self.settings.wanted.method in planning.PLACED:
            return np.asarray(off)
        return estimation.unplaced(off.reshape(-1, 1), places).reshape(-1, 3)

    def _limits(self) -> list[tuple[str, float]]:
        """Return what limits a calibration of the simulated robot, however well it is measured."""
        robot, effects = self.robot, self.robot.rich.effects
        found = [('increments of the encoders', report.increment_m(robot))]
        if self.settings.wanted.method != Method.LEVEL:
            exact = self._calibrated(self._estimated(self._measure(self._planned(), 0.0)))
            off = self._off(self._places(True)[:TRIED], exact)
            found.append((NOT_GEOMETRY, float(np.sqrt((off**2).sum(axis=1).mean()))))
        if effects.gear:
            found.append((BACKLASH, effects.gear_backlash_rad * robot.kinematics.upper_arm_length_m))
        return found

    def _found(
        self,
        estimated: estimation.Estimate,
        measured: Measurements,
        left: list[Left],
        limits: list[tuple[str, float]],
    ) -> Found:
        observation = self._observation(measured)
        free = list(planning.free_of(self.settings.wanted))
        truth = None
        if self.settings.simulate is not None:
            d = self.robot.rich.deviations
            whole = np.concatenate([d.upper_arm_m, d.forearm_m, d.radius_m, d.azimuth_rad, d.angle_rad])
            truth = tuple(whole[free].tolist())
        before, after = (np.linalg.norm(rows, axis=1) for rows in estimated.residuals)
        return Found(
            estimated.told,
            estimated.combinations,
            estimated.directions,
            estimated.freedom,
            tuple(left),
            estimated.scatter,
            estimated.expected_m[1],
            tuple(limits),
            measured,
            model.tcp(observation.shafts, estimated.x, self.robot),
            (before, after),
            model.document_of(estimated.x),
            truth,
        )

    def _write_measured(self, folder: ReportFolder, measured: Measurements) -> Path:
        """Write simulated measurements as a person would fill in the table."""
        folder.make()
        where = model.tcp(
            measured.angles_rad - self.robot.kinematics.corrections.angle_rad,
            model.corrections_of(self.robot.kinematics),
            self.robot,
        )
        poses = dataclasses.replace(
            simulated.scattered(where, measured.checks.tolist()),
            objects=measured.objects,
            diameters_m=measured.diameters_m,
        )
        points = None if measured.objects else measured.points_m
        return measurement_file.write(
            folder.path / MEASURED, poses, measured.angles_rad, folder.provenance, points
        )
