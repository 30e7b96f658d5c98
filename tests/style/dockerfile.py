"""The Dockerfile, without building it: its paths agree, and what it runs is there."""

import pathlib
import re
import shutil
import sys

root = pathlib.Path(sys.argv[1])
lines = [
    line.split(maxsplit=1)
    for line in (root / "Dockerfile").read_text().replace("\\\n", " ").splitlines()
    if line and not line.startswith("#")
]


def only(instruction):
    (text,) = [text for name, text in lines if name == instruction]
    return text


assert [name for name, _ in lines] == ["FROM", "RUN", "COPY", "RUN", "WORKDIR", "ENTRYPOINT", "CMD"], lines
image = only("FROM")
assert f"image: {image}\n" in (root / ".github/workflows/test.yml").read_text(), f"the tests do not run in {image}"
source, tree = only("COPY").split()
assert source == "." and only("WORKDIR") == tree, "the tree is not copied to where the image works"
# A build outside the image contains other paths.
ignored = (root / ".dockerignore").read_text().split()
assert {"build", "out"} <= set(ignored), "a build of the host's would be copied"

script = f"{tree}/tachless"
verbs = re.findall(r"^TACHLESS_VERB\((\w+)\)", (root / "tools/cli/verbs.inc").read_text(), re.MULTILINE)
assert "run" in verbs
commands = [command.split() for name, text in lines if name == "RUN" for command in text.split("&&")]
assert [script] == [command[0] for command in commands if command[0].startswith("/")]
for command in commands:
    if command[0] == script:
        assert command[1] in verbs, f"there is no verb {command[1]}"
    else:
        assert shutil.which(command[0]), f"there is no command {command[0]}"
assert only("ENTRYPOINT") == f'["{script}"]' and (root / "tachless").stat().st_mode & 0o111
