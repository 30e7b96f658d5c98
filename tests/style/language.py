#!/usr/bin/env python3
"""language.py TREE [--counts]: fails on sentences that have to be read twice, and on backticks in messages.

A comment begins with its subject, so it does not begin with one of the words below, and no text uses the phrases
below. A message shows a command without backticks: people would copy these into a shell. --counts prints the number of such lines for each folder instead of the lines.
"""
import collections
import pathlib
import re
import sys

WORDS = "Of|What|That|So|As|Those|Where|Whether|Such|Likewise"
PHRASES = "lost is|did not get on|for good|looks closer"
KINDS = {".h", ".cpp", ".py", ".sh", ".cmake"}
FOLDERS = ("core", "plant", "reference", "controller", "logger", "analysis", "tools", "python", "lcmtypes", "cmake",
           "examples", "scenarios", "bench", "tests")
# A comment's first line: it has code, an empty line or a tag such as @return before it.
BEGINS = re.compile(rf"^(?P<before>.*?)(?P<mark>///<?|//|#) *(?P<tag>@\w+ )?({WORDS})\b")
# In a literal of a program: `words`. Descriptions of keys are Markdown; they are in headers.
MARKDOWN = re.compile(r"""("[^"]*|'[^']*)`[\w-][^`]*`[^"']*["']""")
COMMENT = re.compile(r"^\s*(//|#)")


def bad_lines(text):
    before = ""
    for number, line in enumerate(text.splitlines(), 1):
        match = BEGINS.match(line)
        continues = COMMENT.match(before) and before.rstrip()[-1:] not in ".:;"
        if match and (match["tag"] or match["before"].strip() or not continues):
            yield number, line.strip()
        elif re.search(PHRASES, line):
            yield number, line.strip()
        before = line


def shown_backticks(path):
    if path.suffix in (".cpp", ".js"):
        for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
            if not COMMENT.match(line) and MARKDOWN.search(line):
                yield number, line.strip()


def main():
    tree = pathlib.Path(sys.argv[1])
    files = [path for folder in FOLDERS for path in sorted((tree / folder).rglob("*"))
             if path.suffix in KINDS or path.name == "CMakeLists.txt"]
    found = [(path.relative_to(tree), number, line) for path in files if path.name != "language.py"
             for number, line in bad_lines(path.read_text(errors="replace"))]
    programs = [path for folder in FOLDERS[:7] for path in sorted((tree / folder).rglob("*"))]
    found += [(path.relative_to(tree), number, line) for path in programs for number, line in shown_backticks(path)]
    if "--counts" in sys.argv:
        for folder, count in sorted(collections.Counter("/".join(path.parts[:2]) if len(path.parts) > 2 else path.parts[0]
                                                        for path, _, _ in found).items()):
            print(f"{count:4} {folder}")
    else:
        for path, number, line in found:
            print(f"{path}:{number}: {line}")
    print(f"{len(found)} sentences begin with a word of {WORDS}, have a phrase of {PHRASES}, or show backticks: "
          "put the subject first; print commands bare")
    return 1 if found else 0


sys.exit(main())
