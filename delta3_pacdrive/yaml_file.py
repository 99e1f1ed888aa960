"""The one reader of YAML files: bounded in size, no aliases (no YAML bombs), one sentence for every failure."""

from pathlib import Path
from typing import Any

import yaml

from delta3_pacdrive.errors import Delta3Error, shown

SIZE_MAX_BYTES = 4 * 1024 * 1024


class _Loader(yaml.SafeLoader):
    """Safe loader that refuses anchors, aliases and duplicate keys."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError('aliases are not allowed')
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        keys = set()
        for item, _ in node.value:
            key = self.construct_object(item, deep=True)
            if key in keys:
                raise yaml.YAMLError(f'the key {shown(key)} stands twice at line {item.start_mark.line + 1}')
            keys.add(key)
        return super().construct_mapping(node, deep)


# explicit tags (!!bool, !!int, !!timestamp) of what they do not fit fail in as many ways
_FAILURES = (
    yaml.YAMLError,
    RecursionError,
    ValueError,
    TypeError,
    ArithmeticError,
    LookupError,
    AttributeError,
)


def read(path: str | Path, what: str, error: type[Delta3Error]) -> Any:
    """Return the document in ``path``; ``what`` ("program file") names it in the message of the ``error`` raised."""
    path = Path(path)
    try:
        with path.open('rb') as file:
            content = file.read(SIZE_MAX_BYTES + 1)
    except (OSError, ValueError) as failure:
        reason = getattr(failure, 'strerror', None) or failure
        raise error(f'cannot read {what} {path}: {reason}') from failure
    if len(content) > SIZE_MAX_BYTES:
        raise error(f'{what} {path} is larger than {SIZE_MAX_BYTES // 1024**2} MiB')
    return parse(content, f'{what} {path}', error)


def parse(content: bytes | str, what: str, error: type[Delta3Error]) -> Any:
    """Return the document in a text."""
    try:
        text = content.decode('utf-8') if isinstance(content, bytes) else content
        return yaml.load(text, Loader=_Loader)  # noqa: S506 (a safe loader)
    except _FAILURES as failure:
        reason = ' '.join(str(failure).split()) or type(failure).__name__
        raise error(f'{what} is not valid YAML: {reason}') from failure


def write(path: Path, document: Any) -> None:
    """Write a document."""
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding='utf-8')
