"""Code of functions that only kernels call: nothing is done with it until an entry takes it in.

Numba links into each function's code that of all it calls, optimises the whole and makes machine
code of it, and again for each of its callers. So what lies ten calls deep is optimised ten times.
Here the code of a part stays as it was written, and an entry takes in all its parts and theirs,
each once, and optimises them together, once.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class EntryLibrary(JITCodeLibrary):
    """Code that Python calls, with that of all its parts."""

    def add_linking_library(self, library: Any) -> None:
        """Take in a library, and if it is a part all that it calls."""
        for part in library.with_its_parts() if isinstance(library, PartLibrary) else [library]:
            super().add_linking_library(part)

    def finalize(self) -> None:
        """Link, optimise and make machine code."""
        for part in dict.fromkeys(self._linking_libraries):
            if isinstance(part, PartLibrary):
                self._final_module.link_in(part.module, preserve=True)
        self._linking_libraries = [
            one for one in self._linking_libraries if not isinstance(one, PartLibrary)
        ]
        super().finalize()


class PartLibrary(JITCodeLibrary):
    """Code that is neither optimised nor made executable; parts and entries may call it."""

    @property
    def codegen(self) -> Any:
        """What generates the code, but for the environment of a function that Python calls."""
        return _WithoutEnvironment(super().codegen)

    def with_its_parts(self) -> Iterator[Any]:
        """Yield this library and all that it calls, each once."""
        found: dict[Any, None] = {self: None}
        waiting: list[Any] = [self]
        while waiting:
            library = waiting.pop()
            yield library
            if isinstance(library, PartLibrary):
                new = [one for one in library._linking_libraries if one not in found]
                found.update(dict.fromkeys(new))
                waiting.extend(dict.fromkeys(new))

    def add_llvm_module(self, ll_module: Any) -> None:
        """Take in a module as it is."""
        self._final_module.link_in(ll_module)

    def finalize(self) -> None:
        """Let the library be linked into others."""
        self._raise_if_finalized()
        self._finalize_dynamic_globals()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "external":
                function.linkage = "linkonce_odr"
        self._finalized = True

    @property
    def module(self) -> Any:
        """The code of this part alone, which is not to be changed."""
        return self._final_module

    def _get_module_for_linking(self) -> Any:
        """Return the code with that of all it calls, for a caller that is no entry."""
        if self._shared_module is None:
            whole = self._final_module.clone()
            for library in list(self.with_its_parts())[1:]:
                part = isinstance(library, PartLibrary)
                module = library.module if part else library._get_module_for_linking()
                whole.link_in(module, preserve=True)
            self._shared_module = whole
        return self._shared_module


class EntryCompiler(Compiler):
    """Numba's compiler, which writes into an `EntryLibrary`."""

    library: ClassVar[type[JITCodeLibrary]] = EntryLibrary

    def define_pipelines(self) -> Any:
        """Return Numba's own pipelines, for which a library is there already."""
        codegen, name = self.state.targetctx.codegen(), self.state.func_id.func_qualname
        self.state.library = self.library(codegen, name)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


class PartCompiler(EntryCompiler):
    """Numba's compiler, which writes into a `PartLibrary`."""

    library = PartLibrary


class _WithoutEnvironment:
    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, env_name: str, env: Any) -> None:
        """Leave the environment, which has no address in code that is never run."""
