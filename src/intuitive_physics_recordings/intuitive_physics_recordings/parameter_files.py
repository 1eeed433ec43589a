"""θ_s as files that people read: YAML or JSON, as the ending says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.limits import check_limit

YAML_SUFFIXES = (".yaml", ".yml")
"""Endings of files that are read and written as YAML."""

SUFFIXES = (*YAML_SUFFIXES, ".json")
"""Endings of all files of parameters."""


def save_parameters(learned: LearnedParameters, path: Path) -> None:
    """Write a version of θ_s.

    Raises
    ------
    InvalidInputError
        When the ending is none of `SUFFIXES` or the file cannot be written.
    """
    check_suffix(path)
    data = learned.to_dict()
    if path.suffix in YAML_SUFFIXES:
        text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
    else:
        text = json.dumps(data, indent=2, ensure_ascii=False) + "\n"
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InvalidInputError(f"cannot write {path}: {error.strerror}") from None


def load_parameters(path: Path) -> LearnedParameters:
    """Read a file that `save_parameters` wrote, or a person did.

    Raises
    ------
    InvalidInputError
        As `read_parameter_file`, or when the file holds something else.
    """
    data = read_parameter_file(path)
    try:
        return LearnedParameters.from_dict(data)
    except InvalidInputError as error:
        raise InvalidInputError(f"{path}: {error}") from None


def read_parameter_file(path: Path) -> Any:
    """Return the plain data of a file of parameters, with what else stands in it.

    Raises
    ------
    InvalidInputError
        When the ending is none of `SUFFIXES` or the file cannot be read.
    """
    check_suffix(path)
    try:
        check_limit("longest_text", path.stat().st_size, f"bytes of {path}")
        text = path.read_text(encoding="utf-8")
        return yaml.safe_load(text) if path.suffix in YAML_SUFFIXES else json.loads(text)
    except OSError as error:
        raise InvalidInputError(f"cannot read the parameters {path}: {error.strerror}") from None
    except (UnicodeDecodeError, json.JSONDecodeError, yaml.YAMLError, RecursionError) as error:
        detail = " ".join(str(error).split())
        raise InvalidInputError(f"cannot read the parameters {path}: {detail}") from None


def check_suffix(path: Path) -> None:
    """Raise `InvalidInputError` when a file's name does not end in one of `SUFFIXES`."""
    if path.suffix not in SUFFIXES:
        raise InvalidInputError(
            f"{path} ends in {path.suffix or 'nothing'}; expected one of {', '.join(SUFFIXES)}"
        )
