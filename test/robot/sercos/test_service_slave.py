"""Tests of the drive's end of the service channel: invalid words give no access."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive.robot.sercos.service_channel import Access, Operation
from delta3_pacdrive.robot.sercos.service_endpoints import ServiceSlave
from service_ring import WORDS, Memory
from thoroughness import examples


@given(st.lists(st.one_of(WORDS, st.integers(-10, 2**70)), max_size=200))
@settings(max_examples=examples(300))
def test_invalid_words_raise_no_error_and_reach_the_drive_only_as_well_formed_accesses(words):
    memory = Memory()  # asserts the operation
    slave = ServiceSlave(memory)
    for word in words:
        slave.received(word)
        assert 0 <= slave.to_send() <= 0xFFFF
    for access in memory.accesses:
        assert 0 <= access.idn <= 0xFFFF
        assert isinstance(access.value, float)


@pytest.mark.parametrize('portions', [(0x1001, 0x2010), (0x1001, 0x2020), (0x1001, 0x2000), (0x1C01, 0x2030)])
def test_message_with_invalid_operation_or_reserved_bits_is_ignored(portions):
    memory = Memory()
    slave = ServiceSlave(memory)
    for word in portions * 3:
        slave.received(word)
    assert not memory.accesses
    for word in (0x1400, 0x2000):
        slave.received(word)
    assert memory.accesses == [Access(0, Operation.READ)]
