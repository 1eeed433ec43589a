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

_ARRAY_TYPES = {"NDArray", "ArrayLike", "ndarray"}
_SHAPE = r"(?:^|(?<=[\s,;:]))\((?:[^()]*,[^()]*|\.\.\.|…)?\)"
_ENTRY = re.compile(r"(?P<names>\*{0,2}\w+(?:\s*,\s*\*{0,2}\w+)*)\s*:(?!:)\s*(?P<text>.*)")


def undocumented_arrays(modules: Iterable[Module]) -> list[str]:
    """Return array parameters, fields and results of public functions without a shape.

    Public is what has no leading underscore, in a class that has none, and of the special methods
    `__init__` and `__call__`. An array is what is annotated with NDArray, ArrayLike or np.ndarray,
    alone or inside another type, but not as what a Callable takes or returns; kernels without
    annotations have none.

    A parameter is documented by an entry `name : (n, 3) m` (several names with commas, the shape
    on the entry's first line or those indented below it), or in running text by its name with the
    shape after it: "`name` (n, 3)", "name, shape (n, 3)", "name of shape (n, 3)". A shape is a
    parenthesis with a comma or an ellipsis, or an empty one. The entry stands in the docstring of
    the function; for `__init__` and for the fields of dataclasses and named tuples in that of the
    class, or of the field. A result is documented by a shape in the first paragraph or in the
    section Returns. What a method of the same name in a base class documents need not be repeated.
    """
    modules = list(modules)
    documentation = _Documentation(modules)
    return [place for module in modules for place in documentation.undocumented(module)]


class _Documentation:
    """Docstrings of all classes, so that those of base classes are found."""

    def __init__(self, modules: Iterable[Module]) -> None:
        self._classes = {
            node.name: node
            for _, syntax in modules
            for node in ast.walk(syntax)
            if isinstance(node, ast.ClassDef)
        }

    def undocumented(self, module: Module) -> Iterator[str]:
        for node in module[1].body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and _is_public(node.name):
                yield from self._in_function(module, node, None)
            elif isinstance(node, ast.ClassDef) and _is_public(node.name):
                yield from self._in_class(module, node)

    def _in_class(self, module: Module, owner: ast.ClassDef) -> Iterator[str]:
        fields = set()
        if _has_fields(owner):
            for index, node in enumerate(owner.body):
                if (
                    isinstance(node, ast.AnnAssign)
                    and isinstance(node.target, ast.Name)
                    and _is_public(node.target.id)
                    and _is_array(node.annotation)
                ):
                    fields.add(node.target.id)
                    after = "".join(_string(item) for item in owner.body[index + 1 : index + 2])
                    documented = re.search(_SHAPE, after) or any(
                        _has_entry(text, node.target.id) for text in self._class_texts(owner)
                    )
                    if not documented:
                        yield f"{module[0]}:{node.lineno} {owner.name}.{node.target.id}"
        for node in owner.body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and (
                _is_public(node.name) or node.name in ("__init__", "__call__")
            ):
                yield from self._in_function(module, node, owner, fields)

    def _in_function(
        self,
        module: Module,
        node: Function,
        owner: ast.ClassDef | None,
        fields: Iterable[str] = (),
    ) -> Iterator[str]:
        if any("overload" in ast.unparse(decorator) for decorator in node.decorator_list):
            return
        texts = self._function_texts(node, owner)
        name = node.name if owner is None else f"{owner.name}.{node.name}"
        for parameter in _parameters_of(node, owner is not None):
            is_field = node.name == "__init__" and parameter.arg in fields
            if not _is_array(parameter.annotation) or is_field:
                continue
            if not any(_has_entry(text, parameter.arg) for text in texts):
                yield f"{module[0]}:{parameter.lineno} {name}({parameter.arg})"
        if _is_array(node.returns) and not any(_states_result(text) for text in texts):
            yield f"{module[0]}:{node.lineno} {name} → result"

    def _function_texts(self, node: Function, owner: ast.ClassDef | None) -> list[str]:
        """Return the docstrings in which a function's arrays may be documented."""
        texts = [ast.get_docstring(node) or ""]
        if owner is None:
            return texts
        if node.name == "__init__":
            texts += self._class_texts(owner)
        for base in self._bases(owner):
            texts += [
                ast.get_docstring(method) or ""
                for method in base.body
                if isinstance(method, ast.FunctionDef) and method.name == node.name
            ]
        return texts

    def _class_texts(self, owner: ast.ClassDef) -> list[str]:
        return [ast.get_docstring(node) or "" for node in (owner, *self._bases(owner))]

    def _bases(self, owner: ast.ClassDef) -> list[ast.ClassDef]:
        """Return the base classes among ours, the nearest first."""
        found: list[ast.ClassDef] = []
        ahead = list(owner.bases)
        while ahead:
            name = ast.unparse(ahead.pop(0)).split("[")[0].split(".")[-1]
            base = self._classes.get(name)
            if base is not None and base is not owner and base not in found:
                found.append(base)
                ahead += base.bases
        return found


def _parameters_of(node: Function, is_method: bool) -> list[ast.arg]:
    """Return a function's parameters without `self` and `cls`."""
    positional = [*node.args.posonlyargs, *node.args.args]
    if is_method and not any(
        _name(decorator) == "staticmethod" for decorator in node.decorator_list
    ):
        positional = positional[1:]
    rest = [item for item in (node.args.vararg, node.args.kwarg) if item is not None]
    return [*positional, *node.args.kwonlyargs, *rest]


def _name(decorator: ast.expr) -> str:
    return ast.unparse(decorator).split("(")[0]


def _is_public(name: str) -> bool:
    return not name.startswith("_")


def _has_fields(owner: ast.ClassDef) -> bool:
    marks = [ast.unparse(node) for node in (*owner.decorator_list, *owner.bases)]
    return any("dataclass" in mark or mark.endswith("NamedTuple") for mark in marks)


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


def _has_entry(docstring: str, name: str) -> bool:
    """Whether a docstring states the shape of a parameter."""
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


def _string(statement: ast.stmt) -> str:
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
        return str(statement.value.value)
    return ""
