"""Compiles the sources that refused.cpp includes: refused_lines.py COMPILE...

The compiler's errors are in all lines that end with `// refused`, and in no others: each has a twin beside it that
compiles. One compilation of all sources parses the headers once.
"""
import pathlib
import re
import subprocess
import sys

FOLDER = pathlib.Path(__file__).parent


def errors(said):
    """Returns the places of the errors in the compiler's output, as (file, line)."""
    found = re.findall(r"^([^:\n]+):(\d+):\d+: (?:fatal )?error:", said, re.M)
    return {(pathlib.Path(file).name, int(line)) for file, line in found}


def refused():
    for file in re.findall(r'#include "(.+)"', (FOLDER / "refused.cpp").read_text()):
        lines = [number for number, line in enumerate((FOLDER / file).read_text().splitlines(), 1)
                 if line.endswith("// refused")]
        assert lines, f"{file} has no line that is refused"
        yield from ((file, line) for line in lines)


done = subprocess.run(sys.argv[1:], text=True, capture_output=True, check=False)
found, expected = errors(done.stderr), set(refused())
assert done.returncode != 0 and found == expected, (
    f"errors at {sorted(found)}; expected: {sorted(expected)}\n{done.stderr}")
