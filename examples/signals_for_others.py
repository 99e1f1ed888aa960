"""Export signals of gripper and drives as a table for other tools."""

import csv
import json

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.studies.runs import trace_export

NAMES = ['payload', 'outputs', 'drive_current_reference', 'tcp_speed']

trace = d3.simulate('packaging', signals=NAMES)
table = trace_export.thinned(trace_export.chosen(trace, NAMES, 'packaging'), 5)
trace_file.save(table, 'packaging.csv')

# in another tool: headings with units, numbers, and a metadata file that describes the columns
with open('packaging.csv', encoding='utf-8', newline='') as file:
    next(file)  # skip the comment
    rows = list(csv.DictReader(file))
with open('packaging.csv-metadata.json', encoding='utf-8') as file:
    columns = json.load(file)['tableSchema']['columns']
print(f'{len(rows)} rows of {len(columns)} columns; {columns[1]["titles"]}: {columns[1]["dc:description"]}')

current = np.array([[float(row[f'drive_current_reference_{n} [A]']) for n in (1, 2, 3)] for row in rows])
speed = np.array([float(row['tcp_speed [m/s]']) for row in rows])
grips = np.array([float(row['outputs_gripper']) for row in rows]) > 0.0
for told, part in (('with', grips & (speed > 0.1)), ('without', ~grips & (speed > 0.1))):
    rms = np.sqrt(np.mean(current[part] ** 2))
    print(
        f'{told} the part: {part.sum()} rows, at most {speed[part].max():.2f} m/s, the drives ask for {rms:.2f} A'
    )
