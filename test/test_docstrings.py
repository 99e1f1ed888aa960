"""Every function of the public face and every kernel documents its arguments, with units or shapes.

An argument is documented in the function's own docstring, or in a table that the functions of a module or of a package
share: lines of names in double back-quotes, and below them, indented, what they are.
"""

import ast
import importlib
import inspect
import re
from pathlib import Path

import pytest

import delta3_pacdrive
from cases import for_each

PACKAGE = Path(delta3_pacdrive.__file__).parent
PACKAGES = sorted(path.parent.relative_to(PACKAGE).as_posix() for path in PACKAGE.glob('*/__init__.py'))
NAMES = re.compile(r'^(``\w+``(?:, ``\w+``)*)$')
# a unit, a shape, a record or another class, a count or a number, or yes and no
TELLS = re.compile(r'\[[^\]]+\]|\bshape|``\w|[Nn]umber|[Ww]hether|parameters of a robot|S-0-\d{4}')


def table(docstring):
    """Return the description of each argument in the shared table of a module."""
    found, names = {}, []
    for line in (docstring or '').splitlines():
        if match := NAMES.match(line):
            names = re.findall(r'\w+', match[1])
            found.update(dict.fromkeys(names, ''))
        elif line.startswith('    ') and names:
            found.update({name: f'{found[name]} {line.strip()}' for name in names})
        else:
            names = []
    return found


def parameters_section(docstring):
    """Return the description of each argument in the section ``Parameters`` of a docstring."""
    found, names = {}, []
    section = re.search(r'^Parameters\n-+\n(.*?)(?=^\w+\n-+\n|\Z)', docstring, re.S | re.M)
    for line in section[1].splitlines() if section else ():
        if line.startswith('    '):
            found.update({name: f'{found[name]} {line.strip()}' for name in names})
        elif line.strip():
            names = re.findall(r'\w+', line)
            found.update(dict.fromkeys(names, ''))
    return found


def kernels():
    """Yield every kernel: name of its module, its name, its arguments, its docstring and the shared tables."""
    for path in sorted(PACKAGE.rglob('*.py')):
        tree = ast.parse(path.read_text(encoding='utf-8'))
        shared = dict(table(ast.get_docstring(tree)))
        arrays = path.with_name('arrays.py')
        if arrays.exists():
            shared = table(ast.get_docstring(ast.parse(arrays.read_text(encoding='utf-8')))) | shared
        for node in tree.body:
            if isinstance(node, ast.FunctionDef) and 'kernel' in map(ast.unparse, node.decorator_list):
                arguments = [argument.arg for argument in node.args.args]
                name = path.relative_to(PACKAGE).with_suffix('').as_posix()
                yield pytest.param(arguments, ast.get_docstring(node), shared, id=f'{name}.{node.name}')


def public_functions():
    """Yield the functions that the package, its subpackages and its documented modules export."""
    modules = [
        delta3_pacdrive,
        *(importlib.import_module(f'delta3_pacdrive.{package}') for package in PACKAGES),
    ]
    names = [(module, name) for module in modules for name in getattr(module, '__all__', ())]
    for name in ('kinematics', 'dynamics', 'robot.motor'):
        module = importlib.import_module(f'delta3_pacdrive.{name}')
        names += [(module, one) for one in vars(module) if not one.startswith('_')]
    for module, name in names:
        function = inspect.unwrap(getattr(module, name))
        if inspect.isfunction(function) and function.__module__.startswith('delta3_pacdrive'):
            if (
                module.__name__.count('.')
                and function.__module__ != module.__name__
                and not hasattr(module, '__all__')
            ):
                continue  # imported there
            shared = table(importlib.import_module(function.__module__).__doc__)
            arguments = list(inspect.signature(function).parameters)
            yield pytest.param(
                arguments, inspect.getdoc(function), shared, id=f'{module.__name__}.{function.__name__}'
            )


def require_documented(arguments, docstring, shared):
    assert docstring, 'there is no docstring'
    own = parameters_section(docstring)
    missing = [name for name in arguments if name not in own | shared and f'``{name}``' not in docstring]
    assert not missing, f'nothing is said of {", ".join(missing)}'
    vague = [
        name for name in arguments if name not in own and name in shared and not TELLS.search(shared[name])
    ]
    assert not vague, f'neither unit nor shape is told of {", ".join(vague)}'


@for_each(('arguments', 'docstring', 'shared'), list(kernels()))
def test_every_kernel_documents_its_arguments(arguments, docstring, shared):
    require_documented(arguments, docstring, shared)


@for_each(('arguments', 'docstring', 'shared'), list(public_functions()))
def test_every_public_function_documents_its_arguments(arguments, docstring, shared):
    require_documented(arguments, docstring, shared)


def test_shared_tables_name_only_arguments_that_are_there():
    for path in sorted(PACKAGE.rglob('*.py')):
        named = table(ast.get_docstring(ast.parse(path.read_text(encoding='utf-8'))))
        if named:
            files = path.parent.glob('*.py') if path.name == 'arrays.py' else [path]
            functions = [
                node
                for file in files
                for node in ast.parse(file.read_text(encoding='utf-8')).body
                if isinstance(node, ast.FunctionDef)
            ]
            known = {
                argument.arg for node in functions for argument in (*node.args.args, *node.args.kwonlyargs)
            }
            assert named.keys() <= known, (path.name, sorted(named.keys() - known))


def test_an_argument_without_a_word_and_one_without_a_unit_are_found():
    shared = table('Arguments:\n\n``a``, ``b``\n    Lengths [m].\n``c``\n    Something.\n')
    assert shared == {'a': ' Lengths [m].', 'b': ' Lengths [m].', 'c': ' Something.'}
    require_documented(['a', 'd'], 'Add ``d``.', shared)
    with pytest.raises(AssertionError, match='nothing is said of e'):
        require_documented(['a', 'e'], 'Add.', shared)
    with pytest.raises(AssertionError, match='neither unit nor shape is told of c'):
        require_documented(['c'], 'Add.', shared)
    with pytest.raises(AssertionError, match='no docstring'):
        require_documented([], None, shared)
