"""Parameter file of an estimation: complete, with source and interval as a comment on each estimated value."""

from collections.abc import Mapping, Sequence
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


def notes(problem: Problem, found: Fit, source: str, holds: bool) -> dict[str, list[str]]:
    """Return the comments on each estimated parameter, by dotted name."""
    comments: dict[str, list[str]] = {}
    for quantity, estimate in zip(problem.quantities, found.estimates, strict=False):
        name = quantity.parameter.partition('[')[0]
        if name:
            comments.setdefault(name, []).append(_note(estimate, holds))
    return {name: [', '.join(texts), source] for name, texts in comments.items()}


def _note(estimate: Estimate, holds: bool) -> str:
    if estimate.verdict is Verdict.IDENTIFIABLE:
        width = f'+- {estimate.half_width:.2g} {estimate.unit} (95 %)' if holds else 'no valid interval'
        return f'{estimate.symbol} {width}'
    if np.isfinite(estimate.half_width) and estimate.verdict is Verdict.WEAK and holds:
        return f'{estimate.symbol} {estimate.verdict.value}: +- {estimate.half_width:.2g} {estimate.unit}'
    return f'{estimate.symbol} {estimate.verdict.value}'


def text(
    parameters: Parameters,
    comments: Mapping[str, Sequence[str]],
    provenance: Provenance,
    verdict: Sequence[str],
) -> str:
    """Return the file as text: all parameters, and the ``comments`` on some of them."""
    lines = [f'# {name}: {entry}' for name, entry in provenance.lines().items()]
    lines += [f'# {sentence}' for sentence in verdict]
    lines += ['/**:', '  ros__parameters:']
    group = ''
    for name, value in flat_document(parameters).items():
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


def write(
    path: Path,
    parameters: Parameters,
    problem: Problem,
    found: Fit,
    provenance: Provenance,
    source: str,
    verdict: Sequence[str],
    holds: bool,
) -> Path:
    """Write the file; return its path; raises ReportError."""
    return write_text(text(parameters, notes(problem, found, source, holds), provenance, verdict), path)
