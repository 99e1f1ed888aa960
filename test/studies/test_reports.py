"""Tables and text of the reports that commands write without a folder's summary agree with their documents."""

import ast
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import delta3_pacdrive.studies
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.recording import acquisition
from delta3_pacdrive.studies.calibration import figures as calibration_figures
from delta3_pacdrive.studies.estimation import figures as estimation_figures
from delta3_pacdrive.studies.estimation import report as estimation_report
from delta3_pacdrive.studies.estimation import thesis_setup as chapter_9
from delta3_pacdrive.studies.framework.columns import csv_table
from delta3_pacdrive.studies.places.planning import evaluation as plans
from delta3_pacdrive.studies.places.planning import report as plan_report
from delta3_pacdrive.studies.places.pose import evaluation as poses
from delta3_pacdrive.studies.places.pose import report as pose_report
from delta3_pacdrive.studies.places.workspace import evaluation as workspaces
from delta3_pacdrive.studies.places.workspace import figures as workspace_figures
from delta3_pacdrive.studies.places.workspace import report as workspace_report
from delta3_pacdrive.studies.places.workspace.study import Settings, Slice
from delta3_pacdrive.studies.runs import scope_figure
from place_figures import CONTENTS
from reports_read import read, read_drawing

PLANES = (Slice(2, -0.8), Slice(1, 0.0), Slice(0, 0.3))


def drawing_functions():
    """Return the names of all functions of the analysis that draw a figure for another module."""
    room = Path(delta3_pacdrive.studies.__file__).parent
    for path in sorted({*room.rglob('*figures.py'), *room.rglob('*figure.py')}):
        module = '.'.join(path.relative_to(room).with_suffix('').parts)
        for node in ast.parse(path.read_text(encoding='utf-8')).body:
            match node:
                case ast.FunctionDef(name=name, returns=ast.Name(id='Figure')) if not name.startswith('_'):
                    yield f'{module}.{name}'


def test_every_figure_is_read_by_its_labels_and_curves():
    assert set(drawing_functions()) == {name for name in CONTENTS if not name.startswith('delta3_pacdrive.')}


@pytest.fixture(scope='module')
def mapped(robot):
    return workspaces.study(Settings(0.1, PLANES), robot)


@pytest.mark.parametrize('name', ['reach', *(quantity.key for quantity in workspaces.QUANTITIES)])
def test_a_map_shows_its_quantity_in_each_slice(name, mapped, robot):
    read_drawing(workspace_figures.by_name(mapped, PLANES, robot)[f'{name}.png'])


def test_the_map_of_the_workspace_agrees_with_its_document(robot):
    settings = Settings(0.1, ())
    found = workspaces.study(settings, robot)
    document = workspace_report.document(found, settings, robot)
    text = workspace_report.text(found, settings, robot)
    read(document, text, [workspace_report.extremes_table(found)])


@pytest.mark.parametrize('place', [(0.2, 0.1, -0.85), (-0.3, 0.15, -0.75)])
def test_a_pose_agrees_with_its_document(place, robot):
    pose = poses.of_point(place, robot)
    table = csv_table('solutions.csv', pose.solutions)
    read(pose_report.document(pose, robot), pose_report.text(pose, robot), [table])


@pytest.mark.parametrize('name', ['experiment1', 'experiment2', 'experiment3'])
def test_a_plan_agrees_with_its_document(name, robot):
    program = program_file.load(name, robot.motion)
    found = plans.study(program_planner.plan(program, program.start_m, robot), robot)
    document = plan_report.document(found, robot)
    read(document, plan_report.text(found, robot), plan_report.tables(found))


def test_a_record_of_the_oscilloscope_is_drawn_by_units_from_its_trigger_on(robot):
    channels = ('axis1.current', 'axis2.speed', 'axis1.current_reference')
    wanted = acquisition.setting(robot, channels, 16e3, 2e-3, trigger='axis1.current', level=1.0)
    values = np.random.default_rng(3).standard_normal((wanted.samples, 3))
    for trigger in (None, 10):
        read_drawing(partial(scope_figure.figure_of, acquisition.Record(wanted, 7, values, trigger)))


def test_poses_that_are_to_be_measured_are_drawn_where_they_are(robot):
    points = np.random.default_rng(4).uniform((-0.3, -0.3, -1.0), (0.3, 0.3, -0.7), (12, 3))
    poses = SimpleNamespace(points_m=points, checks=np.arange(12) % 4 == 0)
    read_drawing(partial(calibration_figures.plan_of, poses, robot))


def test_the_estimation_of_chapter_9_agrees_with_its_document():
    draw = np.random.default_rng(9)
    quotients = tuple(
        chapter_9.Quotient(symbol, step, *draw.uniform(0.1, 1.0, 4))
        for symbol in chapter_9.SYMBOLS
        for step in chapter_9.STEPS
    )
    attempts = tuple(
        chapter_9.Attempt(
            step, off, (1.0,) * 5, (1.1,) * 5, tuple(draw.uniform(-0.3, 0.3, 5)), 9.0, cost, 30, 'done'
        )
        for step, cost in zip(chapter_9.ATTEMPT_STEPS, draw.uniform(1.0, 8.0, 4), strict=True)
        for off in (0.3, 0.0)
    )
    profiles = {symbol: tuple(draw.uniform(0.1, 9.0, 11)) for symbol in chapter_9.SYMBOLS}
    found = chapter_9.ThesisStudy(quotients, profiles, attempts, None, None)
    read(estimation_report.thesis_summary(found), [], estimation_report.thesis_tables(found))
    for draw_figure in estimation_figures.of_thesis(found).values():
        read_drawing(draw_figure)
