"""Schema of the messages that browsers may send to the page, and the valid values of each kind of control.

viser sets any attribute of a control that a browser names. Here a message contains a value only, which must have the
type, the range and the options of its control.
"""

import math
from typing import Annotated, Any

import msgspec
import viser

from delta3_pacdrive.errors import shown

PART_BYTES = 512 * 1024  # of a file, as sent by the client of viser
TEXT_MAX, NAME_MAX, UUID_MAX = 4096, 255, 64

Uuid = Annotated[str, msgspec.Meta(max_length=UUID_MAX)]
Three = tuple[float, float, float]


class _Message(msgspec.Struct, tag_field='type', forbid_unknown_fields=True):
    """A message that a browser may send."""


class Camera(_Message, tag='ViewerCameraMessage'):
    """Camera of a browser; no other browser is affected."""

    wxyz: tuple[float, float, float, float]
    position: Three
    fov: float
    near: float
    far: float
    image_height: float
    image_width: float
    look_at: Three
    up_direction: Three


class _Updates(msgspec.Struct, forbid_unknown_fields=True):
    value: bool | float | int | Annotated[str, msgspec.Meta(max_length=TEXT_MAX)]


class Update(_Message, tag='GuiUpdateMessage'):
    """The value of a control."""

    uuid: Uuid
    updates: _Updates


class Hold(_Message, tag='GuiButtonHoldMessage'):
    """A button is held."""

    uuid: Uuid
    frequency: float


class Start(_Message, tag='FileTransferStartUpload'):
    """Announcement of a file that follows in parts."""

    source_component_uuid: Uuid
    transfer_uuid: Uuid
    filename: Annotated[str, msgspec.Meta(max_length=NAME_MAX)]
    mime_type: Annotated[str, msgspec.Meta(max_length=NAME_MAX)]
    part_count: Annotated[int, msgspec.Meta(ge=0)]
    size_bytes: Annotated[int, msgspec.Meta(ge=0)]


class Part(_Message, tag='FileTransferPart'):
    """A part of a file."""

    source_component_uuid: Uuid
    transfer_uuid: Uuid
    part_index: Annotated[int, msgspec.Meta(ge=0)]
    content: Annotated[bytes, msgspec.Meta(max_length=PART_BYTES)]


DECODER = msgspec.msgpack.Decoder(Camera | Update | Hold | Start | Part)


class RejectedError(Exception):
    """A message is rejected; ``fatal``: it cannot come from a browser, and its connection is closed."""

    def __init__(self, reason: str, fatal: bool = False) -> None:
        super().__init__(reason)
        self.fatal = fatal


def decoded(raw: bytes) -> 'Camera | Update | Hold | Start | Part':
    """Return a message; raises RejectedError unless it matches a schema exactly."""
    try:
        return DECODER.decode(raw)  # type: ignore[no-any-return]
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        raise RejectedError(f'it is malformed ({shown(str(error))})', fatal=True) from None


def checked(handle: Any, value: Any) -> Any:
    """Return a value after validation against its control; raises RejectedError."""
    if isinstance(handle, viser.GuiButtonHandle):
        good = value is True
    elif isinstance(handle, viser.GuiCheckboxHandle):
        good = isinstance(value, bool)
    elif isinstance(handle, viser.GuiDropdownHandle | viser.GuiButtonGroupHandle):
        good = isinstance(value, str) and value in handle.options
    elif isinstance(handle, viser.GuiTextHandle):
        good = isinstance(value, str)
    elif isinstance(handle, viser.GuiSliderHandle):
        return _number(handle, value, handle.step)  # the client rounds to steps, up to one beyond an end
    elif isinstance(handle, viser.GuiNumberHandle):
        return _number(handle, value, 0.0)
    else:
        raise RejectedError(f'a browser cannot set a {type(handle).__name__}')
    if not good:
        raise RejectedError(f'{shown(value)} is not a value of {shown(handle.label)}')
    return value


def _number(handle: Any, value: Any, tolerance: float) -> float:
    """Return a number within the limits of its control; values within a tolerance outside are clamped."""
    low = -math.inf if handle.min is None else handle.min
    high = math.inf if handle.max is None else handle.max
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise RejectedError(f'{shown(value)} is not a value of {shown(handle.label)}, which is a number')
    if not low - tolerance <= value <= high + tolerance:
        raise RejectedError(f'{shown(handle.label)} is {value:g}, but must be between {low:g} and {high:g}')
    if isinstance(handle.value, int) and value != int(value):
        raise RejectedError(f'{shown(handle.label)} is {value:g}, but must be a whole number')
    return min(max(value, low), high)
