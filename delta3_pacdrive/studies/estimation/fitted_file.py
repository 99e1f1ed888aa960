"""Parameter file of an estimation: complete, with source and interval as a comment on each estimated value."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from delta3_pacdrive.parameters import Parameters, flat_document
from delta3_pacdrive.studies.estimation.identifiability import Verdict
from delta3_pacdrive.studies.estimation.problem import Problem
from delta3_pacdrive.studies.estimation.solver import Estimate, Fit
from delta3_pacdrive.studies.framework.provenance import Provenance, write_text

NAME = 'fitted.yaml'
NOTE_COLUMN = 50


@dataclass(frozen=True)
class Fitted:
    """Parameters with the estimates, the fit that gave them, and whether its model explains the data."""

    parameters: Parameters
    problem: Problem
    fit: Fit
    holds: bool
    verdict: Sequence[str]  # sentences

    def notes(self, source: str) -> dict[str, list[str]]:
        """Return the comments on each estimated parameter, by dotted name; ``source`` are the inputs."""
        comments: dict[str, list[str]] = {}
        for quantity, estimate in zip(self.problem.quantities, self.fit.estimates, strict=False):
            name = quantity.parameter.partition('[')[0]
            if name:
                comments.setdefault(name, []).append(_note(estimate, self.holds))
        return {name: [', '.join(texts), source] for name, texts in comments.items()}


def _note(estimate: Estimate, holds: bool) -> str:
    if estimate.verdict is Verdict.IDENTIFIABLE:
        width = f'+- {estimate.half_width:.2g} {estimate.unit} (95 %)' if holds else 'no valid interval'
        return f'{estimate.symbol} {width}'
    if np.isfinite(estimate.half_width) and estimate.verdict is Verdict.WEAK and holds:
        return f'{estimate.symbol} {estimate.verdict.value}: +- {estimate.half_width:.2g} {estimate.unit}'
    return f'{estimate.symbol} {estimate.verdict.value}'


def text(fitted: Fitted, source: str, provenance: Provenance) -> str:
    """Return the file as text: all parameters, and comments on those that were estimated."""
    lines = [*provenance.comments(), *(f'# {sentence}' for sentence in fitted.verdict)]
    lines += ['/**:', '  ros__parameters:']
    group, comments = '', fitted.notes(source)
    for name, value in flat_document(fitted.parameters).items():
        own, _, key = name.partition('.')
        if own != group:
            lines.append(f'    {own}:')
            group = own
        line = f'      {key}: {_scalar(value)}'
        if name in comments:
            line = f'{line:<{NOTE_COLUMN}}  # {"; ".join(comments[name])}'
        lines.append(line)
    return '\n'.join(lines) + '\n'


def _scalar(value: Any) -> str:
    return yaml.safe_dump(value, default_flow_style=True, width=10_000).partition('\n')[0]


def write(path: Path, fitted: Fitted, source: str, provenance: Provenance) -> Path:
    """Write the file; return its path; raises ReportError."""
    return write_text(text(fitted, source, provenance), path)
