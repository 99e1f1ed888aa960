"""The README says what is so: its example runs as it stands and prints what the command prints."""

import contextlib
import io
import json
import re
from pathlib import Path

import pytest

from delta3_pacdrive.cli.main import main

README = Path(__file__).parent.parent / 'README.md'


def test_the_python_example_prints_the_largest_tcp_error_as_the_command_does(capsys):
    (example,) = re.findall(r'```python\n(.*?)```', README.read_text(encoding='utf-8'), re.DOTALL)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(example, 'README.md', 'exec'), {})
    error_m, shape = printed.getvalue().split(maxsplit=1)
    assert main(['simulate', 'experiment1', '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert float(error_m) == pytest.approx(result['tcp_error_max_m'], rel=1e-9)
    assert shape.strip() == f'({result["cycles"]}, 3)'
