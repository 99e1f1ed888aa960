"""Calibration study: plans poses, reads or simulates measurements, estimates and writes the parameters."""

import dataclasses
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import CalibrationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.program.file_reader import parse
from delta3_pacdrive.planning.program_planner import plan as plan_program
from delta3_pacdrive.studies.calibration import (
    estimation,
    figures,
    measurement_file,
    model,
    planning,
    report,
    simulated,
)
from delta3_pacdrive.studies.calibration.study import Measurements, Method, Poses, Residual, Result, Settings
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance, os_errors_as
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.runs.inputs import with_digests

POSES, PROGRAM, MEASURED, CALIBRATED = 'poses.csv', 'poses.yaml', 'measurements.csv', 'calibrated.yaml'
TRIED = 40  # further poses at which a simulated robot is compared with its true TCP
TOUCHES = (Method.PLANE, Method.BALL, Method.LEVEL)
NOT_GEOMETRY = 'non-geometric effects, such as gears that yield under weight (residual without noise)'
BACKLASH = 'backlash of the gears, where the weight changes the flank'


@dataclass
class Study(studies.Study):
    """Calibration study; writes poses and a measuring program, or the estimated parameters."""

    settings: Settings

    def __post_init__(self) -> None:
        """Read the parameters of the controller and of the simulated robot; raises ParameterError."""
        s = self.settings
        machine = None if s.simulate is None else core.load(s.simulate)
        own = core.load(s.parameters) if s.parameters is not None or machine is None else machine
        self.robot: Parameters = (
            own if machine is None else dataclasses.replace(machine, kinematics=own.kinematics)
        )

    def plan(self) -> dict[str, Any]:
        """Plan measuring poses, write them as a table and as a program, and return the summary."""
        poses = self._planned()
        folder = self._folder(())
        folder.clear((POSES, PROGRAM))
        angles = simulated.planned_angles(poses, self.robot)
        folder.add(measurement_file.write(folder.path / POSES, poses, angles, folder.provenance))
        program = simulated.program(poses, f'{len(poses.points_m)} poses of a calibration')
        folder.add(report.write_program(folder.path / PROGRAM, program, folder.provenance))
        folder.figures({'poses.png': partial(figures.plan_of, poses, self.robot)}, with_foot=True)
        document = report.plan_document(poses, self.settings.requirements)
        return folder.summary('Poses of a calibration', document, report.plan_text(document))

    def fit(self, path: Path | None) -> dict[str, Any]:
        """Estimate from a file of measurements or from simulated ones; return the summary."""
        folder = self._folder(() if path is None else (str(path),))
        result, calibrated = self.result(path)
        folder.clear((CALIBRATED, *report.TABLES, *figures.NAMES))
        if path is None:
            folder.add(self._write_measured(folder, result.measurements))
        with os_errors_as(f'cannot write {folder.path / CALIBRATED}'):
            folder.make()
            head = report.head(result, folder.provenance)
            folder.add(core.write(calibrated, folder.path / CALIBRATED, head))
        document = report.document(result, self.settings.requirements, folder.path / CALIBRATED)
        drawings = figures.by_name(result, self.robot)
        return folder.results(
            'A calibration', document, report.text(document), report.tables(result), drawings
        )

    def result(self, path: Path | None = None) -> tuple[Result, Parameters]:
        """Estimate like ``fit`` without writing; return the result and the calibrated parameters."""
        measured = self._measured_poses() if path is None else self._read(path)
        self.on_progress('estimating', 0, 0)
        estimated = self._estimated(measured)
        calibrated = self._calibrated(estimated)
        left = list(estimation.compared(estimated, self._observation(measured)))
        limits = [('measuring noise, and parameters that are not identified', estimated.expected_m[1])]
        if self.settings.simulate is not None:
            left += self._truly(calibrated)
            limits += self._limits()
        return self._result(estimated, measured, left, limits), calibrated

    def _folder(self, inputs: tuple[str, ...]) -> ReportFolder:
        s = self.settings
        source = s.parameters or s.simulate
        origin = Provenance.of(
            self.command, self.robot, source, with_digests(inputs), s.seed if s.simulate else None
        )
        return ReportFolder(self.folder, origin)

    def _planned(self) -> Poses:
        self.on_progress('planning poses', 0, 0)
        poses = planning.plan(self.settings.requirements, self.robot)
        program = parse(simulated.program(poses, 'calibration'), self.robot.motion)
        plan_program(program, self.robot.motion.home_m, self.robot)  # rejects poses out of reach
        return poses

    def _measured_poses(self) -> Measurements:
        """Plan poses and measure them in simulation."""
        poses = self._planned()
        self.on_progress('measuring', 0, 0)
        return self._measure(poses, self.settings.requirements.noise_m)

    def _measure(self, poses: Poses, noise_m: float) -> Measurements:
        s = self.settings
        if poses.objects:
            return simulated.touches(poses, self.robot, noise_m, s.seed, s.requirements.height_m)
        return simulated.points(poses, self.robot, s.requirements.method, noise_m, s.seed)

    def _read(self, path: Path) -> Measurements:
        measured = measurement_file.read(path, self.settings.columns)
        if measured.checksum not in ('', 'none', self.robot.checksum):
            raise CalibrationError(
                f'{path} contains angles of a controller with other parameters ({measured.checksum}, expected '
                f'{self.robot.checksum}): specify its parameter file with --parameters'
            )
        method = self.settings.requirements.method
        if not measured.objects and method in TOUCHES:
            raise CalibrationError(f'{path} contains points, not touches: use --method base or frame')
        if measured.objects and method not in TOUCHES:  # the table defines the method
            method = Method.PLANE if np.isnan(measured.diameters_m).all() else Method.BALL
            requirements = dataclasses.replace(self.settings.requirements, method=method)
            self.settings = dataclasses.replace(self.settings, requirements=requirements)
        return measured

    def _observation(self, measured: Measurements) -> model.Observation:
        s = self.settings
        if s.requirements.method == Method.LEVEL:
            return model.Touches(measured, self.robot, True, s.requirements.height_m)
        if measured.objects:
            return model.Touches(measured, self.robot)
        kind = model.PointsInFrame if s.requirements.method == Method.FRAME else model.PointsInBase
        return kind(measured, self.robot)

    def _estimated(self, measured: Measurements) -> estimation.Solution:
        s = self.settings
        return estimation.estimate(
            self._observation(measured),
            s.requirements.noise_m,
            planning.free_of(s.requirements),
            s.requirements.method in planning.PLACED,
        )

    def _calibrated(self, estimated: estimation.Solution) -> Parameters:
        corrections = model.document_of(estimated.x)
        return self.robot.replace(**{f'kinematics__{name}': value for name, value in corrections.items()})

    def _truly(self, calibrated: Parameters) -> list[Residual]:
        """Return the deviations of the true TCP of the simulated robot from its commands."""
        self.on_progress('comparing with the true TCP', 0, 0)
        what = 'true TCP' if self.settings.requirements.method in planning.PLACED else 'true TCP, its shape,'
        groups = (
            (f'{what} with gears loaded by weight', self._places(True)),
            (f'{what} over the whole workspace', self._places(False)),
        )
        return [
            estimation.residual_of(what, *(self._off(group[:TRIED], one) for one in (self.robot, calibrated)))
            for what, group in groups
        ]

    def _places(self, are_pressed: bool) -> Floats:
        """Return random points of the workspace, optionally only where the weight loads all gears on one flank."""
        random = np.random.default_rng(self.settings.seed + 1)
        places = random.permutation(estimation.workspace(self.robot, estimation.FINE))
        return np.asarray(places[planning.pressed(places, self.robot)] if are_pressed else places)

    def _off(self, places: Floats, robot: Parameters) -> Floats:
        poses = simulated.scattered(places, [True] * len(places))
        off = simulated.tcp_at_rest(poses, robot)[1] - places
        if self.settings.requirements.method in planning.PLACED:
            return np.asarray(off)
        return estimation.unplaced(off.reshape(-1, 1), places).reshape(-1, 3)

    def _limits(self) -> list[tuple[str, float]]:
        """Return the sources of error that remain for the simulated robot with perfect measurements."""
        robot, effects = self.robot, self.robot.rich.effects
        found = [('increments of the encoders', report.increment_m(robot))]
        if self.settings.requirements.method != Method.LEVEL:
            exact = self._calibrated(self._estimated(self._measure(self._planned(), 0.0)))
            off = self._off(self._places(True)[:TRIED], exact)
            found.append((NOT_GEOMETRY, float(np.sqrt((off**2).sum(axis=1).mean()))))
        if effects.gear:
            found.append((BACKLASH, effects.gear_backlash_rad * robot.kinematics.upper_arm_length_m))
        return found

    def _result(
        self,
        estimated: estimation.Solution,
        measured: Measurements,
        left: list[Residual],
        limits: list[tuple[str, float]],
    ) -> Result:
        observation = self._observation(measured)
        free = list(planning.free_of(self.settings.requirements))
        truth = None
        if self.settings.simulate is not None:
            d = self.robot.rich.deviations
            whole = np.concatenate([d.upper_arm_m, d.forearm_m, d.radius_m, d.azimuth_rad, d.angle_rad])
            truth = tuple(whole[free].tolist())
        before, after = (np.linalg.norm(rows, axis=1) for rows in estimated.residuals)
        return Result(
            estimates=estimated.estimates,
            combinations=estimated.combinations,
            directions=estimated.directions,
            freedom=estimated.freedom,
            residuals=tuple(left),
            scatter=estimated.scatter,
            expected_m=estimated.expected_m[1],
            limits=tuple(limits),
            measurements=measured,
            points_m=model.tcp(observation.shafts, estimated.x, self.robot),
            residuals_m=(before, after),
            corrections=model.document_of(estimated.x),
            truth=truth,
        )

    def _write_measured(self, folder: ReportFolder, measured: Measurements) -> Path:
        """Write simulated measurements in the format of a filled-in table."""
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
