"""Every block of the README and of the documentation runs as printed.

Pages with long computations: ``test_long_pages``; pages that need a robot: ``../system``.
"""

import re

import pytest

import pages
from cases import for_each

README_LINES_MAX = 150
HERE = [page for page in pages.PAGES if not pages.needs_robot(page) and page not in pages.LONG]
NAMES = [str(page.relative_to(pages.SOURCE)) for page in pages.PAGES]


@pytest.mark.timeout(1800)
@pytest.mark.parametrize('page', HERE, ids=lambda page: str(page.relative_to(pages.SOURCE)))
def test_every_block_of_the_page_runs_unchanged(page, tmp_path):
    pages.run_page(page, tmp_path)


@for_each('page', pages.PAGES)
def test_every_block_has_a_language_that_selects_its_test(page):
    found = pages.blocks(page)
    assert {block.language for block in found} <= pages.LANGUAGES
    assert [block.line for block in found if block.language == 'yaml' and not block.file] == []


@for_each('page', pages.PAGES)
def test_every_file_of_a_page_is_used_by_a_command_below_it(page):
    found = pages.blocks(page)
    for number, block in enumerate(found):
        if block.file:
            assert any(block.file in later.text for later in found[number + 1 :]), block.file


@for_each('page', pages.PAGES)
def test_links_to_files_lead_to_files(page):
    links = re.findall(
        r'\]\(([^)#:]+?)(?:#[^)]*)?\)', re.sub(r'```.*?^```', '', page.read_text(), flags=re.S | re.M)
    )
    assert [link for link in links if not (page.parent / link).exists()] == []


@for_each('page', pages.PAGES)
def test_block_tested_elsewhere_names_its_test(page):
    elsewhere = [block.words for block in pages.blocks(page) if block.mark in ('elsewhere', 'long')]
    assert [name for name in elsewhere if not (pages.SOURCE / name).is_file()] == []


@for_each('page', pages.PAGES)
def test_no_command_of_a_page_is_rejected_for_its_options(page):
    pages.read_page(page)


@for_each('page', pages.PAGES)
def test_a_block_that_is_not_run_each_time_has_commands_that_are_read(page):
    assert [b.line for b in pages.blocks(page) if b.mark == 'long' and not pages.read_commands(b.text)] == []


def test_commands_that_are_only_parsed_have_the_same_rejections():
    assert pages.read_commands('cp a b\ndelta3 tune --set K_Pvel=0.6 | grep x  # a comment\n') == 1
    assert (
        pages.read_commands("yes '' | delta3 run own.py --step; delta3 --help >help.txt && echo delta3\n")
        == 2
    )
    for wrong in (
        'delta3 tune --no-such-option\n',
        'delta3 tune --axis 9\n',
        'delta3 no_such_command\n',
        'delta3 plan experiment1 --no-such-option || echo refused\n',
        'echo | delta3 run --no-such-option\n',
        "delta3 plan '' --no-such-option\n",
    ):
        with pytest.raises(AssertionError, match='refused'):
            pages.read_commands(wrong)


def commands(text):
    return {line.partition(' #')[0].rstrip() for line in text.splitlines()}


def test_block_that_another_test_runs_exists_in_that_test():
    others = [
        (block, pages.SOURCE / block.words)
        for page in pages.PAGES
        for block in pages.blocks(page)
        if block.mark == 'elsewhere' and block.words.endswith('.md')
    ]
    assert others
    for block, other in others:
        there = (one for one in pages.blocks(other) if one.mark != 'elsewhere')
        assert any(commands(block.text) <= commands(one.text) for one in there), block.text


def test_the_readme_is_short():
    assert len((pages.SOURCE / 'README.md').read_text(encoding='utf-8').splitlines()) <= README_LINES_MAX


def test_the_readme_leads_to_every_page_but_their_index():
    readme = (pages.SOURCE / 'README.md').read_text(encoding='utf-8')
    names = {f'docs/{path.name}' for path in (pages.SOURCE / 'docs').glob('*.md')}
    assert sorted(name for name in names if f']({name})' not in readme) == ['docs/index.md']


def test_continuous_integration_calls_the_test_command():
    (block,) = (block for block in pages.blocks(pages.SOURCE / 'README.md') if block.words == '.ci/run')
    command = block.text.strip()
    assert (pages.SOURCE / command).stat().st_mode & 0o100
    assert command in (pages.SOURCE / '.ci/run').read_text(encoding='utf-8').split()


@pytest.mark.parametrize('name', ['docs/architecture.md', 'CONTRIBUTING.md'])
def test_every_address_of_a_source_exists(name):
    text = (pages.SOURCE / name).read_text(encoding='utf-8')
    named = re.findall(r'`([\w/.]+(?:\.py|\.yaml|/))`', text)
    files = {str(path.relative_to(pages.SOURCE)) for path in pages.SOURCE.glob('[!.]*/**/*')}
    assert named
    assert [
        path for path in named if not any(f'/{file}'.endswith(f'/{path.rstrip("/")}') for file in files)
    ] == []
