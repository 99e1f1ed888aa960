"""Tables and texts that the code itself holds, as directives of the pages, so that they cannot grow old."""

import ast
import contextlib
import dataclasses
import io
import os
import tomllib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

SOURCE = Path(__file__).parents[2]
PACKAGE = SOURCE / 'delta3_pacdrive'
TINY = 1e-300
Rows = Iterable[Sequence[object]]


def idns() -> Rows:
    """Return the operation data of a drive."""
    from delta3_pacdrive.robot.drive.operation_data import EXECUTABLE_IN, TABLE
    from delta3_pacdrive.robot.sercos.service_channel import format_idn

    yield 'IDN', 'name', 'unit', 'group', 'written or executed in'
    for row in TABLE.values():
        phases = row.writable_in or EXECUTABLE_IN.get(row.idn, ())
        unit = '' if row.unit == '1' else row.unit
        yield (
            f'`{format_idn(row.idn)}`',
            row.name,
            unit,
            row.group,
            ', '.join(sorted(phase.name for phase in phases)),
        )


def channels() -> Rows:
    """Return the channels of a drive's oscilloscope."""
    from delta3_pacdrive.robot.drive.channels import CHANNELS

    yield 'channel', 'unit', 'what'
    for row in CHANNELS.values():
        yield f'`{row.name}`', '' if row.unit == '1' else row.unit, row.what


def signals() -> Rows:
    """Return the signals that traces hold on request."""
    from delta3_pacdrive.recording.signals import REQUESTED_SIGNALS

    yield 'signal', 'unit', 'what'
    for name, (unit, what) in REQUESTED_SIGNALS.items():
        yield f'`{name}`', '' if unit == '1' else unit, what
    yield '`drive_` and a channel', '', 'channels of the drives: `delta3 scope list`'


def diagnostics() -> Rows:
    """Return the messages of a drive."""
    from delta3_pacdrive.robot.drive.diagnostics import FAULTS, WARNINGS

    yield 'message', 'text', 'class', 'reaction', 'bit'
    for word, table in (('S-0-0011', FAULTS), ('S-0-0012', WARNINGS)):
        for row in table.values():
            reaction = row.reaction.name if row.reaction else 'warning only'
            yield row.number, row.text, row.class_, reaction, f'{word} bit {int(row.bit).bit_length() - 1}'


def fault_kinds() -> Rows:
    """Return the faults that can be injected."""
    from delta3_pacdrive.robot.faults.fault import KINDS

    yield 'fault', 'what', 'happens to', 'value', 'lasts'
    for name, kind in KINDS.items():
        value = f'`{kind.value}` {kind.low:g} to {kind.high:g}' if kind.value else ''
        lasts = '`cycles`' if kind.telegram else 'once' if kind.once else '`for_s`'
        yield f'`{name}`', kind.text, f'`{kind.target}`' if kind.target else 'the robot', value, lasts


def parameters() -> Rows:
    """Return the parameters of a robot, with the packaged values."""
    from delta3_pacdrive import parameters as core

    robot = core.load()
    yield 'parameter', 'default', 'from', 'to', 'what'
    for group, kind in core.groups().items():
        for field in dataclasses.fields(kind):
            value, meta = getattr(getattr(robot, group), field.name), field.metadata
            values = value if isinstance(value, tuple) else (value,)
            without = isinstance(value, bool | str)
            low, high = ('', '') if without else (bound(meta['low']), bound(meta['high']))
            text = ', '.join(
                str(item).lower() if isinstance(item, bool | str) else f'{item:g}' for item in values
            )
            yield f'`{group}.{field.name}`', text, low, high, meta['description']


def bound(value: float) -> str:
    """Return a limit of a parameter; a positive quantity has the smallest number there is as its minimum."""
    return 'above 0' if 0.0 < value < TINY else f'{value:g}'


def topics() -> Rows:
    """Return the topics of a robot."""
    from delta3_pacdrive.ros.wire.interfaces import TOPICS

    yield 'topic', 'type', 'from → to', 'when', 'delivery', 'content'
    for topic in TOPICS:
        ends = f'{", ".join(topic.writers) or "clients"} → {", ".join(topic.readers) or "clients"}'
        marks = [topic.delivery.name, *['recorded'] * topic.recorded, *['one writer'] * topic.one_writer]
        yield f'`{topic.name}`', topic.type.__name__, ends, topic.rate, ', '.join(marks), content(topic)


def content(topic: Any) -> str:
    """Return what a message says, with its layout."""
    from delta3_pacdrive.ros.wire.interfaces import EVERY_AXIS

    parts = [topic.content]
    for telegram in topic.telegrams[:1]:
        if telegram.names:
            joints = EVERY_AXIS if EVERY_AXIS in topic.name else ', '.join(telegram.names)
            arrays = zip(telegram.lengths, ('position', 'velocity', 'effort'), strict=True)
            parts.append(f'names {joints}: {", ".join(f"{n} {array}" for n, array in arrays if n)}')
    if topic.frame:
        parts.append(f'frame `{topic.frame}`')
    if topic.signals:
        parts.append('signals ' + ', '.join(f'`{signal}`' for signal in topic.signals))
    return '; '.join(parts)


def services() -> Rows:
    """Return the services of a robot."""
    from delta3_pacdrive.ros.wire.interfaces import SERVICES

    yield 'service', 'type', 'node', 'needs control', 'what it does'
    for item in SERVICES:
        yield (
            f'`{item.name}`',
            item.type.__name__,
            item.node,
            'yes' if item.needs_control else '',
            item.content,
        )


def deliveries() -> Rows:
    """Return the ways in which messages are delivered."""
    from delta3_pacdrive.ros.wire.interfaces import DELIVERIES

    yield 'delivery', 'writers offer', 'the robot asks for', 'why'
    for item in DELIVERIES:
        yield item.name, profile(item.publisher), profile(item.subscription), item.reason


def profile(qos: Any) -> str:
    """Return a profile of quality of service in words."""
    reliability = qos.reliability.name.lower().replace('_', ' ')
    durability = ', transient local' if qos.durability.name == 'TRANSIENT_LOCAL' else ''
    depth = 'keep all' if qos.history.name == 'KEEP_ALL' else f'last {qos.depth}'
    return f'{reliability}{durability}, {depth}'


def layers() -> list[list[str]]:
    """Return the packages from bottom to top, those of one layer together, from the import contract."""
    contracts = tomllib.loads((SOURCE / 'pyproject.toml').read_text(encoding='utf-8'))['tool']['importlinter']
    (order,) = (
        row['layers'] for row in contracts['contracts'] if row.get('containers') == ['delta3_pacdrive']
    )
    return [line.split(' | ') for line in reversed(order)]


def first_sentence(path: Path) -> str:
    """Return the first line of a module's docstring."""
    return (ast.get_docstring(ast.parse(path.read_text(encoding='utf-8'))) or '').partition('\n')[0]


def packages() -> Rows:
    """Return the packages from top to bottom."""
    yield 'package', 'content'
    for names in reversed(layers()):
        for name in names:
            folder = PACKAGE / name
            same = (
                f' (same layer: {", ".join(f"`{other}`" for other in names if other != name)})'
                if names[1:]
                else ''
            )
            sentence = first_sentence(
                folder / '__init__.py' if folder.is_dir() else folder.with_suffix('.py')
            )
            yield f'`{name}`{same}', sentence.replace('``', '`')


def modules() -> Rows:
    """Return the modules of the package, from bottom to top."""
    yield 'module', 'content'
    for name in (name for names in layers() for name in names):
        folder = PACKAGE / name
        for path in sorted(folder.rglob('*.py')) if folder.is_dir() else [folder.with_suffix('.py')]:
            if path.name != '__init__.py':
                yield f'`{path.relative_to(PACKAGE)}`', first_sentence(path).replace('``', '`')


class Table(SphinxDirective):
    """Shows the rows of a function as a table; the first row is its head."""

    rows: Callable[[], Rows]

    def run(self) -> list[nodes.Node]:
        """Write the table in Markdown, and have it parsed."""
        head, *body = ([str(cell).replace('|', r'\|') for cell in row] for row in type(self).rows())
        lines = [f'| {" | ".join(row)} |' for row in (head, ['---'] * len(head), *body)]
        container = nodes.container()
        self.state.nested_parse(StringList(lines, source=self.env.docname), 0, container)
        return container.children


class Help(SphinxDirective):
    """Shows what ``delta3 COMMAND --help`` prints."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Ask the command."""
        from delta3_pacdrive.cli.main import main

        printed, columns = io.StringIO(), os.environ.get('COLUMNS')
        os.environ['COLUMNS'] = '100'
        try:
            with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
                main([self.arguments[0], '--help'])
        finally:
            os.environ.pop('COLUMNS')
            os.environ.update({} if columns is None else {'COLUMNS': columns})
        return [nodes.literal_block(printed.getvalue(), printed.getvalue(), language='text')]


def setup(app: Sphinx) -> dict[str, Any]:
    """Add a directive for each table."""
    for rows in (
        idns,
        channels,
        signals,
        diagnostics,
        fault_kinds,
        parameters,
        topics,
        services,
        deliveries,
        packages,
        modules,
    ):
        app.add_directive(rows.__name__, type(rows.__name__, (Table,), {'rows': staticmethod(rows)}))
    app.add_directive('help', Help)
    return {'version': '1', 'parallel_read_safe': True, 'parallel_write_safe': True}
