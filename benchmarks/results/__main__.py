"""Makes the Markdown page of each result from its JSON file."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.results.markdown import write_page
from benchmarks.results.result import FOLDER, ResultFileError


def main(arguments: Sequence[str] | None = None) -> int:
    """Write all pages; a file that is no result is named, and the others are written."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.results", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER, help="of the JSON files")
    status = 0
    for path in sorted(parser.parse_args(arguments).folder.glob("*.json")):
        try:
            write_page(path)
        except ResultFileError as error:
            print(f"benchmarks.results: {error}", file=sys.stderr)
            status = 1
    return status


if __name__ == "__main__":
    sys.exit(main())
