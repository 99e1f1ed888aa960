"""``delta3 plot``: the thesis' set of figures for a bag or a trace."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from delta3_pacdrive.cli.output import guarded, parser_for


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = parser_for(
        'plot', 'Draw TCP path, arm angles, velocities, accelerations, currents and TCP error.'
    )
    parser.add_argument('recording', help='rosbag2 folder or trace (.npz, .csv)')
    parser.add_argument(
        '--output', metavar='DIR', default='figures', help='folder for the pictures and their data'
    )
    parser.add_argument('--json', action='store_true', help='print the names of the files as JSON')
    options = parser.parse_args(arguments)
    return guarded(lambda: _plot(options), options.json)


def _plot(options: argparse.Namespace) -> int:
    from delta3_pacdrive import figures, recording
    from delta3_pacdrive.provenance import Provenance, digest

    trace, folder = recording.load(options.recording), Path(options.output)
    # what was recorded knows its parameters itself
    inputs = [f'{options.recording} {digest(Path(options.recording))}']
    origin = Provenance.of(options.command_line, inputs=inputs).lines()
    origin['parameters'] = str(trace.meta.get('checksum', 'unknown'))
    paths = figures.draw(trace, folder, origin)
    trace.meta['plotted'] = origin
    paths.append(folder / 'signals.csv')
    recording.save(trace, paths[-1])
    files = [str(path) for path in paths]
    if options.json:
        print(json.dumps({'ok': True, 'files': files, 'provenance': origin}))
    else:
        print('\n'.join(files))
    return 0


if __name__ == '__main__':
    sys.exit(main())
