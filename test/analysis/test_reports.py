"""Tables and text of the reports that commands write without a folder's summary agree with their documents."""

import pytest

from delta3_pacdrive.analysis.planning import evaluation as plans
from delta3_pacdrive.analysis.planning import report as plan_report
from delta3_pacdrive.analysis.pose import evaluation as poses
from delta3_pacdrive.analysis.pose import report as pose_report
from delta3_pacdrive.analysis.report_folder import Table
from delta3_pacdrive.analysis.workspace import evaluation as workspaces
from delta3_pacdrive.analysis.workspace import report as workspace_report
from delta3_pacdrive.analysis.workspace.study import Settings
from delta3_pacdrive.motion import program_file, program_planner
from reports_read import read


def test_the_map_of_the_workspace_agrees_with_its_document(robot):
    settings = Settings(0.1, ())
    found = workspaces.study(settings, robot)
    document = workspace_report.document(found, settings, robot)
    text = workspace_report.text(found, settings, robot)
    read(document, text, [workspace_report.extremes_table(found)])


@pytest.mark.parametrize('place', [(0.2, 0.1, -0.85), (-0.3, 0.15, -0.75)])
def test_a_pose_agrees_with_its_document(place, robot):
    pose = poses.of_point(place, robot)
    table = Table('solutions.csv', *pose_report.solution_columns(pose))
    read(pose_report.document(pose, robot), pose_report.text(pose, robot), [table])


def test_a_plan_agrees_with_its_document(robot):
    program = program_file.load('experiment1', robot.motion)
    found = plans.study(program_planner.plan(program, program.start_m, robot), robot)
    document = plan_report.document(found, robot)
    read(document, plan_report.text(found, robot), plan_report.tables(found))
