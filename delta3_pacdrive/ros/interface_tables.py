"""The tables of interfaces for people: topics, services and ways of delivery as Markdown or reStructuredText.

``python -m delta3_pacdrive.ros.interface_tables`` writes them as Markdown, with ``rst`` as reStructuredText.
"""

import sys
from collections.abc import Sequence

from rclpy.qos import QoSProfile

from delta3_pacdrive.ros.interfaces import DELIVERIES, EVERY_AXIS, SERVICES, TOPICS, Topic

_ARRAYS = ('position', 'velocity', 'effort')
Rows = list[tuple[str, ...]]
Table = tuple[tuple[str, ...], Rows]  # the first is the header


def topic_table() -> Table:
    """Return the topics: name, type, who writes and reads, when, how, what."""
    rows: Rows = []
    for topic in TOPICS:
        ends = f'{", ".join(topic.writers) or "clients"} → {", ".join(topic.readers) or "clients"}'
        marks = [
            name for name, there in (('recorded', topic.recorded), ('one writer', topic.one_writer)) if there
        ]
        delivery = ', '.join([topic.delivery.name, *marks])
        rows.append((f'`{topic.name}`', topic.type.__name__, ends, topic.rate, delivery, _content(topic)))
    return ('topic', 'type', 'from → to', 'when', 'delivery', 'content'), rows


def _content(topic: Topic) -> str:
    """Return what a message says, with its layout."""
    parts = [topic.content]
    for telegram in topic.telegrams[:1]:
        if telegram.names:
            joints = EVERY_AXIS if EVERY_AXIS in topic.name else ', '.join(telegram.names)
            numbers = [f'{n} {array}' for n, array in zip(telegram.lengths, _ARRAYS, strict=True) if n]
            parts.append(f'joints {joints}: {", ".join(numbers)}')
    if topic.frame:
        parts.append(f'frame `{topic.frame}`')
    if topic.signals:
        parts.append('signals ' + ', '.join(f'`{signal}`' for signal in topic.signals))
    return '; '.join(parts)


def service_table() -> Table:
    """Return the services for readers."""
    rows: Rows = [
        (f'`{item.name}`', item.type.__name__, item.node, 'yes' if item.needs_control else '', item.content)
        for item in SERVICES
    ]
    return ('service', 'type', 'node', 'needs control', 'what it does'), rows


def delivery_table() -> Table:
    """Return the ways of delivery for readers."""
    rows: Rows = [
        (item.name, profile_text(item.publisher), profile_text(item.subscription), item.reason)
        for item in DELIVERIES
    ]
    return ('delivery', 'writers offer', 'the robot asks for', 'why'), rows


def profile_text(profile: QoSProfile) -> str:
    """Return a profile in words."""
    reliability = profile.reliability.name.lower().replace('_', ' ')
    durability = ', transient local' if profile.durability.name == 'TRANSIENT_LOCAL' else ''
    depth = 'keep all' if profile.history.name == 'KEEP_ALL' else f'last {profile.depth}'
    return f'{reliability}{durability}, {depth}'


def markdown(table: Table) -> str:
    """Return a table as Markdown."""
    header, rows = table
    lines = [header, ('---',) * len(header), *rows]
    return ''.join(f'| {" | ".join(cell.replace("|", chr(92) + "|") for cell in line)} |\n' for line in lines)


def rst(table: Table) -> str:
    """Return a table as reStructuredText."""
    header, rows = table
    text = '.. list-table::\n   :header-rows: 1\n\n'
    for line in (header, *rows):
        for place, cell in enumerate(line):
            text += f'   {"* -" if place == 0 else "  -"} {cell.replace("`", "``")}'.rstrip() + '\n'
    return text


def main(arguments: Sequence[str]) -> None:
    """Write all tables."""
    render = rst if 'rst' in arguments else markdown
    sys.stdout.write('\n'.join(map(render, (topic_table(), service_table(), delivery_table()))))


if __name__ == '__main__':
    main(sys.argv[1:])
