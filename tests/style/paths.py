#!/usr/bin/env python3
"""Every file of the tree that a page names between backticks exists: paths.py SOURCE_DIR."""
import re
import sys
from pathlib import Path

root = Path(sys.argv[1])
# The changelog and the page on 0.2 name files of older versions.
pages = [page for page in root.rglob("*.md")
         if not {"build", "CHANGELOG.md", "migration.md"} & set(page.relative_to(root).parts)]
missing, named = [], 0
for page in pages:
    for path in re.findall(r"`([a-z_]+/[\w/.-]+\.(?:h|cpp|c|py|sh|pml|yaml|urdf|lcm|json|cmake))`", page.read_text(encoding="utf-8")):
        named += 1
        places = (root, root / "core", root / "analysis", root / "tools", page.parent)
        if not any((place / path).exists() for place in places):
            missing.append(f"{page.relative_to(root)}: {path} is no file of the tree")
print(*missing, f"{named} paths, {len(missing)} of no file", sep="\n")
sys.exit(bool(missing) or named < 100)
