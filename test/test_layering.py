# SPDX-License-Identifier: Apache-2.0
"""Layering: allowed imports, lengths of modules, documentation of names and numbers."""

import ast
import sys
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

SOURCES = Path(__file__).parents[1] / 'src'
TESTS = Path(__file__).parent
MOST_LINES = 450
MOST_ARGUMENTS = 8

_FLOORS = (
    'exports loop_cache compiling colours command_line progress linkage linear solitons orbit '
    'dynamics actuation estimation identification steering vision microcontroller command'
)
PHYSICS = {room: floor for floor, room in enumerate(_FLOORS.split())}
ROS_NODES = {
    'simulator',
    'edge_actuator',
    'soliton_analyser',
    'soliton_steering',
    'chain_identifier',
}
NODES = {
    'start': 0,
    'runtime': 1,
    'messages': 2,
    **dict.fromkeys(
        {*ROS_NODES, 'bags', 'visualisation', 'camera_encoders', 'serial_encoders'}, 3
    ),
    'foxglove_server': 4,
    'live_view': 4,
    'commands': 4,
    'programs': 5,
}
IMPORTED_BY_PHYSICS = {'soliton_linkage', 'numpy', 'scipy', 'matplotlib'}
IMPORTED_BY_STUDIES = {'mpl_toolkits', 'soliton_linkage_studies', 'yaml'}
KNOWN_TO_BAGS = {
    'soliton_linkage.linkage.quantities',
    'soliton_linkage.progress',
    'soliton_linkage_msgs.srv',
}
PUBLIC_OF_TUPLES = {'_asdict', '_fields', '_make', '_replace'}


def sources(package: str) -> dict[str, ast.Module]:
    """Return the syntax of each module of a package by its dotted name."""
    root = SOURCES / package
    return {
        '.'.join(path.relative_to(root).with_suffix('').parts).removesuffix('.__init__'): parsed
        for path in sorted(root.glob(f'{package}/**/*.py'))
        for parsed in [ast.parse(path.read_text(encoding='utf-8'))]
    }


@cache
def modules() -> dict[str, ast.Module]:
    return {
        **sources('soliton_linkage'),
        **sources('soliton_linkage_studies'),
        **sources('soliton_linkage_nodes'),
    }


@cache
def imports(module: str) -> frozenset[str]:
    """Dotted names that a module imports, down to the module for the project's own packages."""
    names = set()
    for statement in ast.walk(modules()[module]):
        if isinstance(statement, ast.Import):
            names |= {alias.name for alias in statement.names}
        elif isinstance(statement, ast.ImportFrom):
            assert not statement.level, f'{module} imports relatively, line {statement.lineno}'
            for alias in statement.names:
                name = f'{statement.module}.{alias.name}'
                names.add(name if name in modules() else str(statement.module))
    return frozenset(names)


def room(module: str) -> tuple[str, str]:
    """Return the package of a module and its sub-package or, of the package itself, nothing."""
    package, _, inner = module.partition('.')
    return package, inner.partition('.')[0]


def listed(offenders: list[str]) -> str:
    return ''.join(f'\n    {offender}' for offender in offenders)


def test_physics_imports_nothing_but_itself_and_numerics():
    offenders = []
    for module in modules():
        package, inner = room(module)
        if package != 'soliton_linkage_nodes':
            allowed = IMPORTED_BY_PHYSICS | sys.stdlib_module_names
            allowed |= IMPORTED_BY_STUDIES if package == 'soliton_linkage_studies' else set()
            allowed |= {'numba'} if inner in ('compiling', 'loop_cache') else set()
            allowed |= {'argcomplete'} if inner == 'command_line' else set()
            foreign = {name for name in imports(module) if name.split('.')[0] not in allowed}
            offenders += [f'{module} imports {name}' for name in sorted(foreign)]
    assert not offenders, f'physics knows numerics and no ROS:{listed(offenders)}'


def test_packages_import_downwards_only():
    offenders = []
    for module in modules():
        package, inner = room(module)
        if package == 'soliton_linkage_studies':
            continue
        floors = NODES if package == 'soliton_linkage_nodes' else PHYSICS
        assert inner in floors or not inner, f'{module} is on no floor'
        for name in imports(module) & set(modules()):
            other, below = room(name)
            if inner in floors and other == package and below not in (inner, ''):
                is_below = floors[below] < floors[inner]
                offenders += [] if is_below else [f'{module} imports {name}']
            elif inner in floors and other == package and below == '':
                offenders.append(f'{module} imports {name}, which imports everything')
    assert not offenders, f'a package imports from those below it:{listed(sorted(offenders))}'


def test_bags_know_no_linkage_and_no_message_of_it():
    offenders = [
        f'{module} imports {name}'
        for module in modules()
        if room(module) == ('soliton_linkage_nodes', 'bags')
        for name in sorted(imports(module) - KNOWN_TO_BAGS)
        if name.startswith(('soliton_linkage.', 'soliton_linkage_msgs', 'soliton_linkage_nodes.m'))
    ]
    assert not offenders, f'bags play and record whatever there is:{listed(offenders)}'


def test_no_circle_of_imports():
    graph = {module: imports(module) & set(modules()) - {module} for module in modules()}
    outside = True
    while outside:
        imported = set().union(*graph.values())
        outside = {
            module for module, known in graph.items() if not known or module not in imported
        }
        graph = {module: graph[module] - outside for module in set(graph) - outside}
    offenders = [f'{module} imports {name}' for module in graph for name in graph[module]]
    assert not offenders, f'these imports run in a circle:{listed(sorted(offenders))}'


def test_no_module_is_longer_than_450_lines():
    offenders = [
        f'{path.relative_to(SOURCES)}: {count}'
        for path in sorted(SOURCES.glob('soliton_linkage*/soliton_linkage*/**/*.py'))
        if (count := len(path.read_text(encoding='utf-8').splitlines())) > MOST_LINES
    ]
    assert not offenders, f'more than {MOST_LINES} lines in a module:{listed(offenders)}'


def test_no_function_takes_more_than_8_positional_arguments():
    offenders = []
    for module, syntax in modules().items():
        for function in ast.walk(syntax):
            if isinstance(function, ast.FunctionDef):
                names = [each.arg for each in (*function.args.posonlyargs, *function.args.args)]
                count = len(names) - (names[:1] in (['self'], ['cls']))
                if count > MOST_ARGUMENTS:
                    offenders.append(f'{module}:{function.lineno} {function.name}: {count}')
    assert not offenders, f'more than {MOST_ARGUMENTS} positional arguments:{listed(offenders)}'


def test_each_package_describes_its_content():
    folders = {path.parent for path in SOURCES.glob('soliton_linkage*/soliton_linkage*/**/*.py')}
    offenders = [
        str(folder.relative_to(SOURCES))
        for folder in sorted(folders)
        if not (folder / '__init__.py').exists()
        or not ast.get_docstring(ast.parse((folder / '__init__.py').read_text(encoding='utf-8')))
    ]
    assert not offenders, f'no docstring in the __init__.py of:{listed(offenders)}'


def test_a_name_of_a_class_means_one_thing():
    homes = defaultdict(list)
    for module, syntax in modules().items():
        for statement in ast.walk(syntax):
            if isinstance(statement, ast.ClassDef):
                homes[statement.name.lstrip('_')].append(module)
    offenders = [
        f'{name}: {", ".join(modules)}' for name, modules in homes.items() if len(modules) > 1
    ]
    assert not offenders, f'classes of one name for two things:{listed(sorted(offenders))}'


def test_a_number_has_its_reason():
    offenders = [
        f'{module}:{line} {name}'
        for module, syntax in modules().items()
        for name, line in unexplained(syntax.body)
    ]
    assert not offenders, (
        'a constant of the module that is a number has its unit, meaning and reason in a string'
        f' on the next line:{listed(offenders)}'
    )


def unexplained(body: list[ast.stmt]) -> Iterator[tuple[str, int]]:
    """Name and line of each constant with a number in it that no string follows."""
    for statement, following in zip(body, [*body[1:], None], strict=True):
        if isinstance(statement, ast.Assign):
            target, value = statement.targets[0], statement.value
        elif isinstance(statement, ast.AnnAssign) and statement.value:
            target, value = statement.target, statement.value
        else:
            continue
        said = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
        if not isinstance(target, ast.Name) or target.id != target.id.upper():
            continue
        if ast.unparse(value).startswith('types.'):  # a type of numba, with its dimensions
            continue
        if not said and any(map(is_number, ast.walk(value))):
            yield target.id, statement.lineno


def is_number(part: ast.AST) -> bool:
    return (
        isinstance(part, ast.Constant)
        and isinstance(part.value, (int, float))
        and not isinstance(part.value, bool)
    )


def test_tests_of_nodes_use_public_names():
    offenders = [
        f'{path.relative_to(TESTS)}:{part.lineno} {ast.unparse(part)}'
        for path in sorted([*TESTS.glob('nodes/**/*.py'), *TESTS.glob('system/**/*.py')])
        for part in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        if isinstance(part, ast.Attribute)
        if part.attr.startswith('_') and not part.attr.startswith('__')
        if part.attr not in PUBLIC_OF_TUPLES
        if ast.unparse(part.value) not in ('self', 'cls', 'super()')
    ]
    assert not offenders, f'private attributes read by tests:{listed(offenders)}'
