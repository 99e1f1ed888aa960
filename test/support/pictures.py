"""Leaves out the rasterization of figures, half of the time of a study, where no test looks at the pixels."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

from matplotlib.figure import Figure
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from delta3_pacdrive.studies.framework import report_folder
from thoroughness import EVERYTHING


@contextmanager
def undrawn() -> Iterator[None]:
    """Write one pixel, with its metadata, instead of each picture of a report; ``DELTA3_LONG=1`` draws them all."""
    with mock.patch.object(report_folder, 'save', report_folder.save if EVERYTHING else _save):
        yield


def _save(figure: Figure, path: Path, metadata: Mapping[str, str]) -> None:
    for text in figure.findobj(Text):
        if text.get_text().count('$') > 1:
            MathTextParser('path').parse(text.get_text())  # raises ValueError as drawing would
    fields = PngInfo()
    for key, value in metadata.items():
        fields.add_itxt(key, value)
    Image.new('1', (1, 1)).save(path, format='png', pnginfo=fields)
