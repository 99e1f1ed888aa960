"""The scripts in the package are generated from the sources in the repository, with the named libraries."""

import hashlib
import json
import re
from pathlib import Path

from delta3_pacdrive.studies.report_page import page

SOURCE = Path(__file__).parents[3] / 'web/report_page'
ASSETS = Path(page.__file__).parent / 'assets'


def test_the_bundle_is_made_from_the_sources_as_they_are():
    digest = hashlib.sha256((SOURCE / 'package.json').read_bytes())
    for path in sorted((SOURCE / 'src').iterdir()):
        digest.update(path.read_bytes())
    banner = (ASSETS / 'page.js').read_text(encoding='utf-8').partition('\n')[0]
    made_from = re.search(r'sources ([0-9a-f]{16})', banner)[1]
    assert made_from == digest.hexdigest()[:16], 'bundle again: cd web/report_page && npm run bundle'


def test_the_bundler_writes_into_the_package():
    script = (SOURCE / 'bundle.js').read_text(encoding='utf-8')
    folder = (SOURCE / re.search(r"ASSETS = '([^']+)'", script)[1]).resolve()
    assert folder == SOURCE.parents[1] / 'delta3_pacdrive/studies/report_page/assets'
    assert (folder / 'page.js').is_file()


def test_versions_are_exact_and_their_licences_are_in_the_package():
    versions = json.loads((SOURCE / 'package.json').read_text(encoding='utf-8'))['devDependencies']
    assert all(re.fullmatch(r'\d+\.\d+\.\d+', version) for version in versions.values())
    licences = (ASSETS / 'LICENSES.txt').read_text(encoding='utf-8')
    assert f'three.js {versions["three"]}' in licences
    assert f'uPlot {versions["uplot"]}' in licences
    assert licences.count('Permission is hereby granted, free of charge') == 2
