"""Text of the response to an access to drive data.

A separate module, because clients that only send requests do not need the drive's tables, which load the compiler.
"""

from delta3_pacdrive.controller.service_texts import answer_text
from delta3_pacdrive.drive.operation_data import TABLE, refusal, value_text
from delta3_pacdrive.sercos.configuration_check import ALL_DRIVES
from delta3_pacdrive.sercos.service_channel import Access, Answer, Operation, format_idn


def outcome(index: int, access: Access, answer: Answer) -> str:
    """Return the response as text."""
    if answer.error:
        return answer_text(False, f'{ALL_DRIVES[index]}: {refusal(access, answer)}')
    row = TABLE[access.idn]
    result = ': done' if access.operation == Operation.COMMAND else f' = {value_text(row, answer.value)}'
    return answer_text(True, f'{ALL_DRIVES[index]}: {format_idn(access.idn)} {row.name}{result}')
