"""``delta3 experiment --graph``: the same experiment by nodes."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path


def test_nodes_give_the_report_of_the_simulation_but_for_what_no_topic_tells(
    tmp_path: Path, delta3: Callable[..., subprocess.CompletedProcess[str]], nothing_left_behind: None
) -> None:
    done = delta3(
        'experiment', '3', '--graph', '--no-attribution', '--output', tmp_path, '--json', timeout=240.0
    )
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document['reproduced'] is True
    assert document['missing'] == ['arm_angle_true', 'tcp_true', 'tcp_error_norm_true']
    assert document['truth'] == ''
    agreeing = [note for note in document['notes'] if 'agree to the last bit in 11 signals' in note]
    assert len(agreeing) == 2
    assert {'bag_model', 'bag_robot', 'signals.csv'} <= {path.name for path in tmp_path.iterdir()}
