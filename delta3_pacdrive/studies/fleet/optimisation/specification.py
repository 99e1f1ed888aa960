"""Files of optimisations: like those of sweeps, with a goal and a number of trials instead of runs and sampling.

program: experiment1
parameters: rich                # optional
trials: 60
together: 8                     # optional: number of trials chosen at a time
seed: 1                         # optional
vary:
  drive.velocity_gain_a_s_rad: {uniform: [0.1, 0.5]}            # range
  drive.interpolation: {list: [linear, cubic]}                  # choices
goal: {minimise: tcp_error_max_m}                               # or maximise; a figure, or a name of keep
limits: {current_rms_a_1: 3.5}                                  # optional: upper limits
keep: []                        # optional, as are function and name: as in sweeps
"""

import hashlib
import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from delta3_pacdrive.configuration.source_positions import place_of, place_of_key
from delta3_pacdrive.configuration.strict_reader import Errors, Section, refuse
from delta3_pacdrive.configuration.value_readers import one_of, whole_number_between
from delta3_pacdrive.errors import SweepError, shown
from delta3_pacdrive.studies.fleet.optimisation.study import Optimisation
from delta3_pacdrive.studies.fleet.sweep import specification as sweeps
from delta3_pacdrive.studies.fleet.sweep.single_run import figure_names
from delta3_pacdrive.studies.fleet.sweep.study import Law, Sampling, Sweep

TRIALS_MAX, TOGETHER, TOGETHER_MAX = 10_000, 8, 64
MINIMISE, MAXIMISE = 'minimise', 'maximise'
KEYS = (*(key for key in sweeps.KEYS if key not in ('runs', 'sampling')), 'trials', 'together', 'goal')


def load(path: str | Path) -> Optimisation:
    """Read the file of an optimisation; raises SweepError, ParameterError and ProgramError."""
    path = Path(path)
    document, source = sweeps.document_of(path, 'optimisation')
    errors = Errors(str(path))
    found: list[Optimisation] = []
    with errors.raised_as(SweepError), errors.noted(place_of(document)):
        required = ('program', 'trials', 'vary', 'goal')
        fields = Section(document, 'the optimisation', errors, KEYS, required)
        trials = fields.read('trials', whole_number_between(1, TRIALS_MAX), 1, prefix='')
        together = fields.read('together', whole_number_between(1, TOGETHER_MAX), TOGETHER, prefix='')
        sweep = sweeps.sweep_of(
            fields=fields, path=path, errors=errors, source=source, runs=trials, sampling=Sampling.RANDOM
        )
        for one in sweep.vary:
            if one.law not in (Law.LIST, Law.UNIFORM):
                with errors.noted(place_of_key(document['vary'], one.key)):
                    refuse(f'{one.key} is {one.law}, but must be list or uniform in an optimisation')
        names = [one.name for one in sweep.keep] or figure_names()
        maximise, goal = fields.read(
            'goal',
            partial(_goal, errors=errors, names=None if sweep.function else names),
            (False, ''),
            prefix='',
        )
        own = Optimisation(sweep, goal, maximise, together)
        found.append(replace(own, sweep=replace(sweep, digest=digest_of(own))))
    return found[0]


def _goal(value: Any, where: str, errors: Errors, names: list[str] | None) -> tuple[bool, str]:
    """Read the goal."""
    fields = Section(value, where, errors, (MINIMISE, MAXIMISE))
    given = [key for key in (MINIMISE, MAXIMISE) if key in fields]
    if len(given) != 1:
        refuse(f'{where} must be {MINIMISE} or {MAXIMISE} of one number, not {shown(value)}')
    read = sweeps.name_of_number if names is None else one_of(names)
    return given[0] == MAXIMISE, fields.read(given[0], read, '')


def digest_of(optimisation: Optimisation) -> str:
    """Return a digest of everything on which the trials depend, except for their number."""
    from importlib.metadata import version

    sweep: Sweep = replace(optimisation.sweep, runs=0)
    search = [
        version('optuna'),
        optimisation.goal,
        optimisation.maximise,
        optimisation.together,
        dict(sweep.limits),
    ]
    text = json.dumps([sweeps.digest_of(sweep), search], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
