"""``delta3 experiment --graph``: the same experiment by nodes."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.cli import experiment_graph
from delta3_pacdrive.errors import RunError


@pytest.mark.long
def test_nodes_give_the_report_of_the_simulation_except_unpublished_values(
    tmp_path: Path, delta3: Callable[..., subprocess.CompletedProcess[str]], nothing_left_behind: None
) -> None:
    done = delta3(
        'experiment', '3', '--graph', '--no-attribution', '--output', tmp_path, '--json', timeout=240.0
    )
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert {claim['verdict'] for claim in document['claims']} <= {
        'holds',
        'does not hold',
        'depends on the seed',
        'cannot be known',
    }
    assert document['missing'] == ['arm_angle_true', 'tcp_true', 'tcp_error_norm_true']
    assert document['truth'] == ''
    agreeing = [note for note in document['notes'] if 'agree to the last bit in 15 signals' in note]
    assert len(agreeing) == 2
    assert {'bag_model', 'bag_robot', 'signals.csv'} <= {path.name for path in tmp_path.iterdir()}


def test_nodes_that_cannot_run_give_one_message_and_leave_no_bag(tmp_path: Path) -> None:
    program = tmp_path / 'far.yaml'
    program.write_text('moves: [{move_l: {to_m: [3.0, 0.0, -0.8]}}]')
    robots = {'model': parameters.config_directory() / parameters.DEFAULT_FILE}
    with pytest.raises(RunError, match=r'^nodes of the model: .*move_l'):
        experiment_graph.Graph(tmp_path, 0.0)(program, robots, {}, lambda *_: None)
    assert {path.name for path in tmp_path.iterdir()} == {'far.yaml'}
