"""Public arrays whose docstring does not state their shape."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeAlias

Function: TypeAlias = ast.FunctionDef | ast.AsyncFunctionDef
"""A function's definition in the syntax tree."""

Module: TypeAlias = tuple[Path, ast.Module]
"""A file and its syntax."""

Classes: TypeAlias = dict[str, ast.ClassDef]
"""Definitions of classes by their names."""

_ARRAY_TYPES = {"NDArray", "ArrayLike", "ndarray"}
_SHAPE = r"(?:^|(?<=[\s,;:]))\((?:[^()]*,[^()]*|\.\.\.|…)?\)"
_ENTRY = re.compile(r"(?P<names>\*{0,2}\w+(?:\s*,\s*\*{0,2}\w+)*)\s*:(?!:)\s*(?P<text>.*)")


def undocumented_arrays(modules: Iterable[Module]) -> list[str]:
    """Return array parameters, fields and results of public functions without a shape.

    Public is what has no leading underscore, in a class that has none, and of the special methods
    `__init__` and `__call__`. An array is what is annotated with NDArray, ArrayLike or np.ndarray,
    alone or inside another type, but not as what a Callable takes or returns.

    A parameter is documented by an entry `name : (n, 3) m` (several names with commas, the shape
    on the entry's first line or those indented below it), or in running text by its name with the
    shape after it: "`name` (n, 3)", "name, shape (n, 3)", "name of shape (n, 3)". A shape is a
    parenthesis with a comma or an ellipsis, or an empty one. A result is documented by a shape in
    the first paragraph or in the section Returns. The docstring is that of the function, of its
    class, of a base class, or of a base's method of the same name; for a field also the field's.
    """
    modules = list(modules)
    classes = {
        node.name: node
        for _, syntax in modules
        for node in ast.walk(syntax)
        if isinstance(node, ast.ClassDef)
    }
    return [
        f"{path}:{place}"
        for path, syntax in modules
        for owner in (syntax, *syntax.body)
        if isinstance(owner, ast.Module) or (isinstance(owner, ast.ClassDef) and _is_public(owner))
        for place in _undocumented(owner, classes)
    ]


def _undocumented(owner: ast.Module | ast.ClassDef, classes: Classes) -> Iterator[str]:
    prefix = f"{owner.name}." if isinstance(owner, ast.ClassDef) else ""
    fields: set[str] = set()
    for index, node in enumerate(owner.body):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            if _is_public(node):
                texts = [ast.get_docstring(node) or "", *_texts(owner, node.name, classes)]
                known = fields if node.name == "__init__" else set()
                yield from _in_function(node, prefix, texts, known)
        elif prefix and isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            name = node.target.id
            if name.startswith("_") or not _is_array(node.annotation):
                continue
            fields.add(name)
            after = ast.Module(owner.body[index + 1 : index + 2], [])
            has_own = re.search(_SHAPE, ast.get_docstring(after) or "")
            if not has_own and not _has_entry(_texts(owner, "", classes), name):
                yield f"{node.lineno} {prefix}{name}"


def _in_function(node: Function, prefix: str, texts: list[str], fields: set[str]) -> Iterator[str]:
    if any("overload" in ast.unparse(decorator) for decorator in node.decorator_list):
        return
    arguments = node.args
    several = [item for item in (arguments.vararg, arguments.kwarg) if item is not None]
    for item in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, *several):
        is_undocumented = _is_array(item.annotation) and not _has_entry(texts, item.arg)
        if is_undocumented and item.arg not in fields:
            yield f"{item.lineno} {prefix}{node.name}({item.arg})"
    if _is_array(node.returns) and not any(_states_result(text) for text in texts):
        yield f"{node.lineno} {prefix}{node.name} → result"


def _texts(owner: ast.AST, method: str, classes: Classes) -> list[str]:
    """Return the docstrings of a class and its bases, and of their methods of this name."""
    if not isinstance(owner, ast.ClassDef):
        return []
    methods = [node for node in owner.body if isinstance(node, ast.FunctionDef)]
    texts = [ast.get_docstring(owner) or ""]
    texts += [ast.get_docstring(node) or "" for node in methods if node.name == method]
    for base in owner.bases:
        base_class = classes.get(ast.unparse(base).split("[")[0].split(".")[-1])
        if base_class not in (None, owner):
            texts += _texts(base_class, method, classes)
    return texts


def _is_public(node: Function | ast.ClassDef) -> bool:
    return not node.name.startswith("_") or node.name in ("__init__", "__call__")


def _is_array(annotation: ast.expr | None) -> bool:
    """Whether an annotation has an array anywhere but in a Callable or a ClassVar."""
    if annotation is None:
        return False
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        return _is_array(ast.parse(annotation.value, mode="eval").body)
    if isinstance(annotation, ast.Subscript):
        outer = ast.unparse(annotation.value).split(".")[-1]
        if outer in ("Callable", "ClassVar", "Literal"):
            return False
    if isinstance(annotation, ast.Name | ast.Attribute):
        return ast.unparse(annotation).split(".")[-1] in _ARRAY_TYPES
    return any(
        _is_array(child)
        for child in ast.iter_child_nodes(annotation)
        if isinstance(child, ast.expr)
    )


def _has_entry(docstrings: Iterable[str], name: str) -> bool:
    """Whether a docstring states the shape of a parameter."""
    return any(_has_entry_in(text, name) for text in docstrings)


def _has_entry_in(docstring: str, name: str) -> bool:
    if re.search(rf"(?<!\w){re.escape(name)}`?,?\s+(?:(?:of\s+)?shape\s+)?{_SHAPE}", docstring):
        return True
    lines = docstring.splitlines()
    for index, line in enumerate(lines):
        entry = _ENTRY.fullmatch(line.strip())
        if entry is None or name not in re.split(r"[\s,*]+", entry["names"]):
            continue
        indent = len(line) - len(line.lstrip())
        text = entry["text"]
        for following in lines[index + 1 :]:
            if len(following) - len(following.lstrip()) <= indent:
                break
            text += " " + following.strip()
        if re.search(_SHAPE, text):
            return True
    return False


def _states_result(docstring: str) -> bool:
    summary = docstring.split("\n\n")[0]
    results = re.findall(
        r"^(?:.*[.] )?(?:Returns|Yields)(?:\n-+\n|\s)(.*?)(?:\n\n|\Z)", docstring, re.M | re.S
    )
    return any(re.search(_SHAPE, text) for text in (summary, *results))
