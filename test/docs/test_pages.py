# SPDX-License-Identifier: Apache-2.0
"""The pages name existing files, topics and parameters."""

import ast
import re

import pytest
import yaml
from pages import DOCS, PAGES, ROOT, directives, table
from parameter_rows import parameter_rows

from soliton_linkage_nodes.runtime import interfaces

LINK = re.compile(r'(?<!`)\[[^\]]*\]\(([^)#\s]*)(#[^)\s]*)?\)')
NAMED_FILE = re.compile(r'`((?:config|bags|examples|setup|src|test|benchmark)/[\w./-]+\.\w+)`')
OF_THE_CODE = [
    *(DOCS / f'{name}.md' for name in ('physics', 'glossary', 'architecture', 'analyser', 'bags')),
    *DOCS.glob('extending/*.md'),
]
"""Pages that use the names of the code."""
MOST_PICTURES = 1_200_000
"""Bytes that all pictures may take in the repository."""


def test_every_file_that_a_page_names_is_there():
    for page in PAGES:
        text = page.read_text(encoding='utf-8')
        linked = [page.parent / target for target, _ in LINK.findall(text) if target]
        local = [path for path in linked if '://' not in str(path) and ':/' not in str(path)]
        missing = [path for path in local if not path.exists()]
        missing += [ROOT / name for name in NAMED_FILE.findall(text) if not (ROOT / name).exists()]
        assert not missing


@pytest.fixture(scope='module')
def sources():
    """Names and contents of all sources and tests."""
    paths = [
        path for folder in ('src', 'test', 'benchmark') for path in (ROOT / folder).rglob('*.*')
    ]
    texts = [
        path.read_text(encoding='utf-8')
        for path in paths
        if path.suffix in ('.py', '.pyi', '.msg', '.action')
    ]
    return '\n'.join([*map(str, paths), *texts])


def test_names_on_a_page_exist_in_the_code(sources):
    for page in OF_THE_CODE:
        names = set(
            re.findall(r'(?<!`)`([A-Za-z_][\w./]*)`(?!`)', page.read_text(encoding='utf-8'))
        )
        unknown = {
            name
            for name in names
            if not name.startswith(('my_run', 'out/'))
            and not all(part in sources for part in re.split(r'[./]+', name.strip('./')))
        }
        assert not unknown


def test_the_python_on_a_page_is_python():
    for page in PAGES:
        for block in re.findall(r'```python\n(.*?)```', page.read_text(encoding='utf-8'), re.S):
            ast.parse(block)


def test_rows_of_a_table_have_equal_numbers_of_cells():
    for page in PAGES:
        text = page.read_text(encoding='utf-8')
        text = re.sub(r'```.*?```|`[^`\n]*`|\\\|', '', text, flags=re.S)
        for rows in re.findall(r'(?:^ *\|.*\n)+', text, re.M):
            assert len({row.count('|') for row in rows.splitlines()}) == 1, rows


def test_the_readme_fits_on_two_pages():
    assert len((ROOT / 'README.md').read_text(encoding='utf-8').splitlines()) < 150


def test_the_readme_s_script_runs(capsys):
    (script,) = re.findall(r'```python\n(.*?)```', (ROOT / 'README.md').read_text(), re.S)
    exec(script, {})
    assert 'direction=1' in capsys.readouterr().out


def test_the_table_of_topics_is_that_of_the_nodes():
    told = {}
    for name, kind, _, meaning in table(DOCS / 'nodes.md', '## Topics'):
        type_name = re.findall(r'`(.*?)`', kind)[0]
        told[name.strip('`')] = (type_name, 'latched' in kind)
        assert meaning
    topics = [each for each in vars(interfaces).values() if isinstance(each, interfaces.Topic)]
    assert told == {
        topic.name: (
            f'{topic.type.__module__.partition(".")[0]}/{topic.type.__name__}',
            topic.latched,
        )
        for topic in topics
    }


def test_every_parameter_is_in_a_table():
    shown = {
        row[0].strip('`')
        for arguments in directives('parameters')
        for row in parameter_rows(*arguments)
    }
    text = (ROOT / 'config/linkage.yaml').read_text(encoding='utf-8')
    sections = yaml.safe_load(text)
    known = {
        name
        for node, section in sections.items()
        if not node.endswith('experiment')
        for name in section['ros__parameters']
    }
    commented = set(re.findall(r'^    # ([\w.]+): ', text, re.M))
    assert known <= shown
    assert shown - known <= commented | {name for name in shown if '.deviations.' in name}


def test_each_picture_has_a_caption_and_all_are_small():
    pictures = [path for path in DOCS.glob('pictures/*') if path.suffix != '.txt']
    assert sum(path.stat().st_size for path in pictures) < MOST_PICTURES
    for path in DOCS.glob('pictures/*.png'):
        assert path.with_suffix('.txt').read_text(encoding='utf-8').strip(), path
