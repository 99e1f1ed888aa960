"""Tests of the modules of a study: model, data, report and figures, run, each imported by later ones only."""

import ast
from pathlib import Path

import pytest

import delta3_pacdrive.studies

ROOM = Path(delta3_pacdrive.studies.__file__).parent
WITH_DATA, RUN = (
    sorted(
        str(path.parent.relative_to(ROOM))
        for path in ROOM.rglob(f'{name}.py')
        if path.parent.name != 'framework'
    )
    for name in ('study', 'run')
)
LATER = {'report', 'figures', 'run', 'acceptance'}


def body(node):
    """Return the contents of a module or class apart from its docstring."""
    return node.body[1:] if ast.get_docstring(node) else node.body


def test_every_study_is_looked_at():
    assert RUN == [
        'calibration',
        'drives/commissioning',
        'drives/one_motor',
        'drives/ripple',
        'drives/tuning',
        'estimation',
        'fleet/line',
        'fleet/optimisation',
        'fleet/sweep',
        'learning',
        'thesis/experiments',
        'thesis/jacobian',
    ]
    assert set(RUN) <= set(WITH_DATA)


def imported(tree):
    """Return the names that a module imports, apart from numpy and from the data of another study."""
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    nodes = [node for node in nodes if not str(node.module).endswith('.study')]
    return {alias.asname or alias.name for node in nodes for alias in node.names}


@pytest.mark.parametrize('study', WITH_DATA)
def test_study_module_contains_data_classes_only(study):
    tree = ast.parse((ROOM / study / 'study.py').read_text(encoding='utf-8'))
    assert not [node for node in body(tree) if isinstance(node, ast.FunctionDef)]
    classes = [node for node in body(tree) if isinstance(node, ast.ClassDef)]
    assert classes
    for node in classes:
        decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
        assert decorators == ['dataclass(frozen=True)'] or [base.id for base in node.bases] == ['StrEnum']
        for part in body(node):
            if isinstance(part, ast.FunctionDef):
                # a property or method is another view of the fields: it computes with nothing else but numpy
                decorators = [ast.unparse(decorator) for decorator in part.decorator_list]
                assert decorators in ([], ['property']), part.name
                names = {
                    name.id for line in part.body for name in ast.walk(line) if isinstance(name, ast.Name)
                }
                assert not names & imported(tree), part.name
            else:
                assert isinstance(part, ast.AnnAssign | ast.Assign), f'{node.name}: {ast.unparse(part)}'


@pytest.mark.parametrize('study', RUN)
def test_model_of_a_study_does_not_import_its_run_and_report(study):
    for path in sorted((ROOM / study).glob('*.py')):
        if path.stem in LATER:
            continue
        tree = ast.parse(path.read_text(encoding='utf-8'))
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                package, _, module = node.module.rpartition('.')
                names = {alias.name for alias in node.names} if module == Path(study).name else {module}
                folder = 'studies.' + study.replace('/', '.')
                own = node.module.endswith(folder) or package.endswith(folder)
                assert not (own and names & LATER), f'{path.name}: {ast.unparse(node)}'
