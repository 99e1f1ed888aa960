"""The data of a report page, decoded in Python as its scripts do."""

import base64
import json
import re
import zlib

import numpy as np

NOTHING = -(2**31)


def document_of(text):
    """Return the document in the text of a page."""
    found = re.search(r'<script type="application/json" id="report">(.*?)</script>', text, re.DOTALL)
    return json.loads(found[1])


def unpacked(packed, rows):
    """Return the columns of a packed signal, shape (rows, columns)."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed['data'])), np.uint8)
    planes = planes.reshape(packed['columns'], 4, rows).astype(np.uint32)
    zigzag = sum(planes[:, n] << np.uint32(8 * n) for n in range(4))
    whole = (zigzag >> np.uint32(1)).astype(np.int64) ^ -(zigzag & np.uint32(1)).astype(np.int64)
    for _ in range(packed['order']):
        whole = np.cumsum(whole, axis=1)
    whole = whole.astype(np.uint64).astype(np.uint32).view(np.int32)
    return np.where(whole == NOTHING, np.nan, whole * packed['resolution']).T


def signals_of(series):
    """Return times and signals of a run, or of a difference, in the document of a page."""
    rows = series['cycles']
    time_s = series['first_s'] + np.arange(rows) * series['period_s']
    return time_s, {name: unpacked(packed, rows) for name, packed in series['signals'].items()}


def cell_of(document):
    """Return the cell of a page with its packed columns put back, shapes (cycles, belts), (rows, 4) and (rows, 5)."""
    cell = dict(document['cell'])
    if cell['ways'] is not None:
        cell['ways'] = unpacked(cell['ways'], document['runs'][0]['cycles'])
    cell['stays'] = np.rint(unpacked(cell['stays'], cell['rows'])).astype(int)
    cell['places'] = unpacked(cell['places'], cell['rows'])
    return cell


def parts_at(cell, cycle, tcp_m):
    """Return where parts are in a bus cycle from the first one of the page on: places [m], by their numbers."""
    found = {}
    for (row, begin, how, belt), place in zip(cell['stays'], cell['places'], strict=True):
        if begin > cycle:
            continue
        at, kind = place[:3].copy(), cell['hows'][how]
        if kind == 'in hand':
            at += tcp_m
        if kind == 'riding':
            direction = cell['things'][cell['belts'][belt]][4]
            gone = cell['ways'][cycle, belt] - place[4]
            at += gone * np.array([np.cos(direction), np.sin(direction), 0.0])
        found[cell['parts'][row][0]] = None if kind == 'gone' else at
    return {number: at for number, at in found.items() if at is not None}
