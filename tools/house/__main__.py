"""Print one JSON line with the size and order of the source tree, or the places behind a number.

python3 -m tools.house
python3 -m tools.house --details largest_folder
"""

from __future__ import annotations

import argparse
import json
import textwrap
from collections.abc import Sequence
from pathlib import Path

from tools.house.measures import MEASURES, measure
from tools.house.source_tree import SourceTree

REPOSITORY = Path(__file__).resolve().parents[2]
"""The repository that this file belongs to."""

LONGEST_LIST = 40
"""Most places that are printed for a number that is the largest of all places."""


def main(arguments: Sequence[str] | None = None, root: Path = REPOSITORY) -> None:
    """Measure the repository below `root` and print what was asked for."""
    options = _parser().parse_args(arguments)
    if options.details is None:
        print(json.dumps(measure(root)))
        return
    item = MEASURES[options.details]
    places = item.places(SourceTree(root))
    for place in places[:LONGEST_LIST] if item.is_largest else places:
        print(place)


def _parser() -> argparse.ArgumentParser:
    definitions = "\n\n".join(
        f"{key}:\n{textwrap.indent(item.definition, '  ')}" for key, item in MEASURES.items()
    )
    parser = argparse.ArgumentParser(
        prog="python3 -m tools.house",
        description=(
            "Print one JSON line with the size and order of the source tree.\n"
            "A number is the largest amount or the count of:\n\n" + definitions
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--details", choices=MEASURES, metavar="KEY", help="list the places behind one number"
    )
    return parser


if __name__ == "__main__":
    main()
