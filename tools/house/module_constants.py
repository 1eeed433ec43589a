"""Module constants and whether each has a docstring."""

from __future__ import annotations

import ast
import re

from tools.house.source_tree import Place, SourceModule, SourceTree

_CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")
_NO_CONSTANTS = {"dtype", "from_dtype", "TypeVar", "ParamSpec", "NewType"}


def module_constants_without_docstring(tree: SourceTree) -> list[Place]:
    """Module-level assignments to ALL_CAPS names in `src/` that no string literal follows.

    Names with a leading underscore count too. A comment is no docstring. Definitions of dtypes and
    of type variables, and `__all__`, are no constants. A statement that assigns to several names
    counts once.
    """
    return [place for module in tree.package_modules for place in _in_module(module)]


def _in_module(module: SourceModule) -> list[Place]:
    body = module.syntax.body
    places = []
    for index, statement in enumerate(body):
        names = _constants(statement)
        if names and not (index + 1 < len(body) and _is_string(body[index + 1])):
            places.append(module.place(statement.lineno, ", ".join(names)))
    return places


def _constants(statement: ast.stmt) -> list[str]:
    """Return the constants that a statement defines."""
    if isinstance(statement, ast.Assign):
        targets = statement.targets
    elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
        targets = [statement.target]
    else:
        return []
    value = statement.value
    if isinstance(value, ast.Call) and ast.unparse(value.func).split(".")[-1] in _NO_CONSTANTS:
        return []
    return [
        node.id
        for target in targets
        for node in ast.walk(target)
        if isinstance(node, ast.Name)
        and isinstance(node.ctx, ast.Store)
        and _CONSTANT.fullmatch(node.id)
    ]


def _is_string(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )
