"""Write requirements/constraints.txt: what every package of requirements/*.txt resolves to.

Run it to take over newer versions, with one interpreter for each Python that is supported:

    python3 tools/lock_requirements.py python3.10 python3.11 python3.12 python3.13

Each resolves on its own; a version that is not the same for all gets a marker.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

FOLDER = Path(__file__).resolve().parent.parent / "requirements"
HEADING = "# Made by tools/lock_requirements.py: exact versions of all that is installed.\n"


def main() -> None:
    constraints = FOLDER / "constraints.txt"
    constraints.write_text(HEADING)
    resolved = {}
    for interpreter in sys.argv[1:]:
        version, packages = resolve(interpreter)
        resolved[version] = packages
        print(f"Python {version}: {len(packages)} packages")
    constraints.write_text(HEADING + "".join(f"{line}\n" for line in merged(resolved)))


def resolve(interpreter: str) -> tuple[str, dict[str, str]]:
    """Return the Python version of an interpreter and what it resolves to, version by name."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([interpreter, "-m", "venv", folder], check=True)
        python = f"{folder}/bin/python"
        requirements = [f"--requirement={path}" for path in sorted(FOLDER.glob("[!c]*.txt"))]
        report = f"{folder}/report.json"
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--upgrade", "pip"], check=True)
        subprocess.run(
            [python, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed"]
            + [f"--report={report}", *requirements],
            check=True,
        )
        answer = json.loads(Path(report).read_text())
    version = ".".join(answer["environment"]["python_full_version"].split(".")[:2])
    items = (item["metadata"] for item in answer["install"])
    return version, {item["name"].lower().replace("_", "-"): item["version"] for item in items}


def merged(resolved: dict[str, dict[str, str]]) -> list[str]:
    """Return one line for each package and version, with a marker where Pythons differ."""
    pythons: dict[tuple[str, str], list[str]] = defaultdict(list)
    for python, packages in resolved.items():
        for pin in packages.items():
            pythons[pin].append(python)
    versions = defaultdict(set)
    for name, version in pythons:
        versions[name].add(version)
    lines = []
    for (name, version), pythons_of in sorted(pythons.items()):
        marker = " or ".join(f'python_version == "{python}"' for python in pythons_of)
        lines.append(f"{name}=={version}" + (f" ; {marker}" if len(versions[name]) > 1 else ""))
    return lines


if __name__ == "__main__":
    main()
