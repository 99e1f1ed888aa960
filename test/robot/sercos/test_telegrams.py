"""Tests of words in the frames of telegrams, and of their session."""

from collections.abc import Callable

import pytest

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.words import PAYLOAD_MAX_KG, Phase

OURS, OTHERS = b'3fa9', b'3faa'


@pytest.mark.parametrize(
    'frame',
    [
        b'',
        b'CP4',
        b'CP4 e000 e000',
        b'XX4 e000 e000 e000 1',
        b'CP4 e000 zzzz e000 0000 0000 0000 1 00 3fa9',
        b'CP4 e000 -00f e000 0000 0000 0000 1 00 3fa9',
        b'CP4 e000 fffff000 e000 0000 0000 0000 1 00 3fa9',
        b'CP9 e000 e000 e000 0000 0000 0000 1 00 3fa9',
        b'CP4 e000 e000 e000 0000 0000 0000 nan 00 3fa9',
        b'CP4 e000 e000 e000 0000 0000 0000 1 3fa9',
        b'CP4 e000 e000 e000 0000 0000 0000 1 0 3fa9',
        b'CP4 e000 e000 e000 0000 0000 0000 1 zz 3fa9',
        b'\xff',
    ],
)
def test_mdt_frames_of_another_form_are_rejected(frame: bytes) -> None:
    with pytest.raises(TelegramError, match=r'is not "CPn wwww wwww wwww ssss ssss ssss ppp\.pppp oo hhhh"'):
        telegrams.parse_mdt_frame(frame, 1, b'3fa9')


@pytest.mark.parametrize(
    'frame',
    [b'', b'c008 3fa9', b'zzzz 0000 3fa9', b'-008 0000 3fa9', b'ffffffffffffffffffff 0000 3fa9', b'\xff'],
)
def test_at_frames_of_another_form_are_rejected(frame: bytes) -> None:
    with pytest.raises(TelegramError, match='of an AT is not "wwww ssss hhhh"'):
        telegrams.parse_at_frame(frame, b'3fa9')


@pytest.mark.parametrize(
    'parse',
    [
        lambda: telegrams.parse_mdt_frame(telegrams.mdt_frame(4, 0xE000, 0.5, OTHERS), 1, OURS),
        lambda: telegrams.parse_at_frame(telegrams.at_frame(0xC008, 0, OTHERS), OURS),
        lambda: telegrams.parse_current_frame(telegrams.current_frame(True, 0.5, OTHERS), OURS),
        lambda: telegrams.require_session(OTHERS, OURS),
    ],
)
def test_telegram_of_another_session_is_rejected_with_both_names(parse: Callable[[], object]) -> None:
    with pytest.raises(TelegramError, match="belongs to session '3faa', but this one is 3fa9"):
        parse()


def test_sessions_are_random_and_never_the_reserved_one() -> None:
    drawn = {telegrams.new_session() for _ in range(200)}
    assert len(drawn) > 150
    assert telegrams.NO_SESSION not in drawn
    assert {len(session) for session in drawn} == {telegrams.SHAFTS.frame_length}


def test_frames_keep_their_definition() -> None:
    mdt = telegrams.mdt_frame(4, 0xE000, 0.5, OURS, (1, 2, 0x9FFF), 0x81)
    assert telegrams.parse_outputs(mdt, OURS) == 0x81
    assert len(mdt) == telegrams.MDT.frame_length
    assert [telegrams.parse_mdt_frame(mdt, axis, OURS) for axis in range(3)] == [
        (4, 0xE000, 1, 0.5),
        (4, 0xE000, 2, 0.5),
        (4, 0xE000, 0x9FFF, 0.5),
    ]
    at = telegrams.at_frame(0xC008, 0x1234, OURS)
    assert (len(at), telegrams.parse_at_frame(at, OURS)) == (telegrams.AT[0].frame_length, (0xC008, 0x1234))
    current = telegrams.current_frame(False, 9.5, OURS)
    assert len(current) == len(telegrams.CURRENT_FRAME)
    assert telegrams.parse_current_frame(current, OURS) == (False, 9.5)


def test_frames_read_as_the_documentation_writes_them() -> None:
    mdt = telegrams.mdt_frame(4, 0xE000, 0.0125, OURS, (1, 2, 0x9FFF))
    assert mdt == b'CP4 e000 e000 e000 0001 0002 9fff 000.0125 00 3fa9'
    assert telegrams.at_frame(0xC008, 0x1234, OURS) == b'c008 1234 3fa9'
    assert telegrams.current_frame(True, 0.0125, OURS) == b'free 000.0125 3fa9'
    assert telegrams.current_frame(False, 12.0, OURS) == b'held 012.0000 3fa9'


@pytest.mark.parametrize('payload', ['-0.1', f'{1.01 * PAYLOAD_MAX_KG:.4f}', 'nan', 'inf'])
def test_payload_without_a_gripper_is_rejected(payload: str) -> None:
    with pytest.raises(TelegramError, match='of a motor current is not'):
        telegrams.parse_current_frame(f'free {payload} 3fa9'.encode(), OURS)
    with pytest.raises(TelegramError, match='of an MDT is not'):
        telegrams.parse_mdt_frame(f'CP4 e000 e000 e000 0000 0000 0000 {payload} 00 3fa9'.encode(), 0, OURS)


@pytest.mark.parametrize('frame', [b'', b'CP4', b'1 zz 3fa9', b'1 -1 3fa9', b'1 001 3fa9', b'\xff'])
def test_outputs_of_another_form_are_rejected(frame: bytes) -> None:
    with pytest.raises(TelegramError, match='of an MDT is not'):
        telegrams.parse_outputs(frame, OURS)


def test_raw_session_that_is_not_text_is_rejected() -> None:
    with pytest.raises(TelegramError, match='belongs to session'):
        telegrams.parse_at_frame(b'c008 0000 \xff\xff\xff\xff', b'3fa9')
    with pytest.raises(TelegramError, match='belongs to session'):
        telegrams.require_session(b'\xff\xff\xff\xff', b'3fa9')


def test_the_text_of_a_phase_reads_back() -> None:
    for phase in Phase:
        assert telegrams.parse_phase_text(telegrams.phase_text(phase, OURS)) == (phase, OURS)
