"""Measure whether the tests of guard, register transfer and judge notice changes of their code: make mutants.

Each mutant is one small change, such as ``<`` instead of ``<=``. The tests are collected once per module; a forked
process then replaces the code of a function and runs them until the first one fails. A mutant that none notices
survives: its test is missing, unless the change has no effect.

    python -m tests.mutation [MODULE]
"""

import ast
import copy
import importlib
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

#: Lowest percentage of the mutants that the tests must notice.
MIN_SCORE = 90.0

#: Quick tests of each module.
TESTS = {
    "calstation.sequencer.guard": ["tests/sequencer/test_guard.py"],
    "calstation.devices.imu.register_transfer": ["tests/devices/test_transfer.py"],
    "calstation.judgement.judge": ["tests/judgement/test_judge.py", "tests/judgement/test_model_tests.py"],
}

_SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip


def nodes(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield the nodes of the functions of a module, without docstrings, annotations and logging."""
    pending: list[ast.AST] = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    while pending:
        node = pending.pop(0)
        if isinstance(node, ast.Expr) and (isinstance(node.value, ast.Constant) or "logger." in ast.unparse(node)):
            continue
        if isinstance(node, ast.keyword) and node.arg == "strict":  # of a zip of equally long sequences
            continue
        yield node
        skipped = {"annotation", "returns", "type_comment", "decorator_list"}
        for name, value in ast.iter_fields(node):
            children = value if isinstance(value, list) else [value]
            pending += [child for child in children if isinstance(child, ast.AST) and name not in skipped]


def change(node: ast.AST) -> Iterator[str]:
    """Change a node in place in each possible way; yield the description of each change, and undo it afterwards."""
    before = dict(vars(node))
    for description, changes in _changes(node):
        vars(node).update(changes)
        yield description
        vars(node).update(before)


def _changes(node: ast.AST) -> Iterator[tuple[str, dict[str, object]]]:
    match node:
        case ast.Compare():
            for k, operator in enumerate(node.ops):
                swapped = _SWAPPED[type(operator)]
                yield swapped.__name__, {"ops": [*node.ops[:k], swapped(), *node.ops[k + 1 :]]}
        case ast.BoolOp() | ast.BinOp() if type(node.op) in _SWAPPED:
            yield _SWAPPED[type(node.op)].__name__, {"op": _SWAPPED[type(node.op)]()}
        case ast.If() | ast.While() | ast.IfExp():
            yield "negated", {"test": ast.UnaryOp(ast.Not(), node.test)}
        case ast.Return(value=ast.expr() as value) if not (isinstance(value, ast.Constant) and value.value is None):
            yield "returns None", {"value": ast.Constant(None)}
        case ast.Expr(value=ast.Call()):
            yield "omitted", {"value": ast.Constant(None)}
        case ast.Constant(value=bool() as value):
            yield str(not value), {"value": not value}
        case ast.Constant(value=int() | float() as value):
            yield f"{value} + 1", {"value": value + 1}
        case ast.Constant(value=str() as value):
            yield f"other than {value!r}", {"value": value + "_"}


def mutants(tree: ast.Module) -> Iterator[tuple[str, ast.Module]]:
    """Yield the description and the code of every mutant."""
    for node in nodes(tree):
        text = ast.unparse(node).partition("\n")[0]
        for description in change(node):
            yield f"{getattr(node, 'lineno', 0)}: {text[:90]}: {description}", copy.deepcopy(tree)


def install(tree: ast.Module, name: str) -> None:
    """Replace the code of the functions of a loaded module."""
    module = importlib.import_module(name)
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    changed = dict(vars(module))
    part = ast.fix_missing_locations(ast.Module([*functions], []))
    exec(compile(part, module.__file__ or name, "exec"), changed)
    for node in functions:
        vars(module)[node.name].__code__ = changed[node.name].__code__


class Mutation:
    """Plugin of pytest that runs the collected tests for every mutant of a module."""

    def __init__(self, name: str) -> None:
        self.name, self.survivors, self.count = name, list[str](), 0

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run the tests without a change, then for every mutant."""
        tree = ast.parse(Path(importlib.import_module(self.name).__file__ or "").read_text("utf-8"))
        begin = time.monotonic()
        if not self.pass_with(session, tree, 600.0):
            pytest.exit("the tests fail without a change", 2)
        limit = 30.0 + 5.0 * (time.monotonic() - begin)
        for description, mutant in mutants(tree):
            self.count += 1
            if self.pass_with(session, mutant, limit):
                self.survivors.append(description)
                print(f"survived: {self.name}:{description}", flush=True)
        return True

    def pass_with(self, session: pytest.Session, tree: ast.Module, limit: float) -> bool:
        """Return whether all tests pass with this code; a process that takes longer than `limit` s is killed."""
        child = os.fork()
        if child == 0:
            os.setpgid(0, 0)
            for number in (1, 2):
                os.dup2(os.open(os.devnull, os.O_WRONLY), number)
            install(tree, self.name)
            for item, following in zip(session.items, [*session.items[1:], None], strict=True):
                session.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                if session.testsfailed:
                    os._exit(1)
            os._exit(0)
        end = time.monotonic() + limit
        while time.monotonic() < end:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                return status == 0
            time.sleep(0.01)
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return False


def main(names: list[str]) -> int:
    """Run the mutants of the modules, print survivors and scores, and return 1 if a score is too low."""
    code = 0
    for name in names or TESTS:
        plugin = Mutation(name)
        pytest.main([*TESTS[name], "-q", "-s", "-p", "no:cacheprovider"], [plugin])
        score = 100.0 * (1.0 - len(plugin.survivors) / max(plugin.count, 1))
        print(f"{name}: {plugin.count} mutants, {len(plugin.survivors)} survived, {score:.1f} % noticed", flush=True)
        code |= not plugin.count or score < MIN_SCORE
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
