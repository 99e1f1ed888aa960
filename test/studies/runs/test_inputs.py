"""Tests of the meaning of the inputs of a study."""

from pathlib import Path

from delta3_pacdrive.studies.runs.inputs import bags_in


def bag(folder):
    folder.mkdir(parents=True)
    (folder / 'metadata.yaml').write_text('')
    return str(folder)


def test_folder_of_bags_expands_to_them_and_other_arguments_stay(tmp_path):
    bags = [bag(tmp_path / 'hall' / name) for name in ('robot2', 'robot1')]
    assert bags_in(str(tmp_path / 'hall')) == sorted(bags)
    for one in (bags[0], 'packaging', str(tmp_path / 'nothing'), str(tmp_path)):
        assert bags_in(one) == [one]


def test_unreadable_folder_is_passed_on_as_argument(tmp_path, monkeypatch):
    def refuse(_):
        raise PermissionError(13, 'Permission denied')

    monkeypatch.setattr(Path, 'iterdir', refuse)
    assert bags_in(str(tmp_path)) == [str(tmp_path)]
