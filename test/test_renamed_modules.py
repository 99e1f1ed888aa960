"""Old module names of release 0.1 still import, with a warning that names the new module."""

import importlib
import sys

import pytest

from delta3_pacdrive import cell, scripting
from delta3_pacdrive.renamed_modules import PACKAGE, RENAMED


@pytest.mark.parametrize('old', RENAMED)
def test_an_old_name_imports_the_module_and_warns(old):
    sys.modules.pop(f'{PACKAGE}.{old}', None)
    with pytest.warns(FutureWarning, match=RENAMED[old]):
        module = importlib.import_module(f'{PACKAGE}.{old}')
    assert module is importlib.import_module(f'{PACKAGE}.{RENAMED[old]}')
    assert module.__spec__.name == f'{PACKAGE}.{RENAMED[old]}'


@pytest.mark.parametrize('name', scripting.__all__)
def test_cell_still_offers_the_names_of_scripting_and_warns(name):
    with pytest.warns(FutureWarning, match='delta3_pacdrive.scripting'):
        assert getattr(cell, name) is getattr(scripting, name)


def test_a_name_that_never_existed_is_not_found():
    for name in ('motion.nothing', 'nothing'):
        with pytest.raises(ModuleNotFoundError):
            importlib.import_module(f'{PACKAGE}.{name}')
    with pytest.raises(AttributeError, match='nothing'):
        getattr(cell, 'nothing')  # noqa: B009
