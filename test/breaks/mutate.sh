#!/usr/bin/env bash
# Mutation test of one module: runs tests against each mutant that cosmic-ray makes, in a copy of the package.
#
#   pip install cosmic-ray
#   test/breaks/mutate.sh planning/timing/blending.py test/planning/timing/test_blending.py [LINE-LINE]
#
# With a range of lines, only mutants of these lines are run. The list of survivors is printed at the end.
set -euo pipefail
module=${1:?module of the package} tests=${2:?tests} lines=${3:-}
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf -- "$work"' EXIT
cp -r "$root/delta3_pacdrive" "$root/test" "$root/pyproject.toml" "$work"
cp -r "$root/config" "$work/delta3_pacdrive/config"
cd "$work"
cat >mutation.toml <<TOML
[cosmic-ray]
module-path = "delta3_pacdrive/$module"
timeout = 120.0
test-command = "python -m pytest -q -x -p no:cacheprovider $tests"
[cosmic-ray.distributor]
name = "local"
TOML
if [[ -n $lines ]]; then
    printf '[cosmic-ray.filters.line-filter]\nlines = {"delta3_pacdrive/%s" = ["%s"]}\n' "$module" "$lines" >>mutation.toml
fi
export PYTHONPATH=$work PYTHONSAFEPATH=1 MPLBACKEND=Agg
cosmic-ray init mutation.toml session.sqlite
if [[ -n $lines ]]; then
    cr-filter-lines --config mutation.toml session.sqlite
fi
cosmic-ray baseline mutation.toml
cosmic-ray exec mutation.toml session.sqlite
cr-report --surviving-only --show-diff session.sqlite
