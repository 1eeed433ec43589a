"""How long functions are and how much they ask for."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from typing import TypeAlias

from tools.house.source_tree import Place, SourceTree

Function: TypeAlias = ast.FunctionDef | ast.AsyncFunctionDef
"""A function's definition in the syntax tree."""


def argument_lists(tree: SourceTree) -> list[Place]:
    """Every function and method of `src/` with the number of its parameters.

    Positional and keyword parameters count, `*args` and `**kwargs` as one each; `self` and `cls`
    do not, nor do the fields of a dataclass.
    """
    return [
        module.place(node.lineno, f"{node.name} has {count} parameters", count)
        for module in tree.package_modules
        for node, is_method in functions_of(module.syntax)
        for count in [len(parameters_of(node, is_method))]
    ]


def function_lengths(tree: SourceTree) -> list[Place]:
    """Every function and method of `src/` with its lines, from `def` to its end.

    Decorators and the docstring do not count.
    """
    return [
        module.place(node.lineno, f"{node.name} has {lines} lines", lines)
        for module in tree.package_modules
        for node, _ in functions_of(module.syntax)
        for lines in [_length(node)]
    ]


def functions_of(syntax: ast.AST) -> Iterator[tuple[Function, bool]]:
    """Yield every function below a syntax tree, and whether it is a method."""
    for node in ast.walk(syntax):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
                yield child, isinstance(node, ast.ClassDef)


def parameters_of(node: Function, is_method: bool) -> list[ast.arg]:
    """Return a function's parameters without `self` and `cls`."""
    positional = [*node.args.posonlyargs, *node.args.args]
    if is_method and not any(
        _name(decorator) == "staticmethod" for decorator in node.decorator_list
    ):
        positional = positional[1:]
    rest = [item for item in (node.args.vararg, node.args.kwarg) if item is not None]
    return [*positional, *node.args.kwonlyargs, *rest]


def _length(node: Function) -> int:
    lines = (node.end_lineno or node.lineno) - node.lineno + 1
    if ast.get_docstring(node, clean=False) is not None:
        text = node.body[0]
        lines -= (text.end_lineno or text.lineno) - text.lineno + 1
    return lines


def _name(decorator: ast.expr) -> str:
    return ast.unparse(decorator).split("(")[0]
