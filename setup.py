"""The compiled half of the Python package for pip: built by CMake, in $TACHLESS_BUILD or build/release."""

import os
import pathlib
import re
import shutil
import subprocess

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

root = pathlib.Path(__file__).resolve().parent
build = pathlib.Path(os.environ.get("TACHLESS_BUILD", root / "build" / "release"))


class ByCMake(build_ext):
    def build_extension(self, ext):
        target = pathlib.Path(self.get_ext_fullpath(ext.name))
        made = build / "python" / "tachless" / target.name
        configure = ["cmake", build] if (build / "build.ninja").is_file() else [
            "cmake", "-S", root, "-B", build, "--preset", "release", "-DTACHLESS_TESTS=OFF"]
        for command in configure, ["cmake", "--build", build, "--target", "python_module"]:
            if subprocess.run(command, cwd=root, check=False).returncode != 0:
                raise SystemExit(f"tachless: {command[0]} failed; `./tachless package` installs what the build needs")
        if not made.is_file():
            raise SystemExit(f"tachless: no {made}: the module is for Debian's /usr/bin/python3; "
                             "make the virtual environment with that")
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(made, target)


setup(version=re.search(r"project\(tachless VERSION ([0-9.]+)", (root / "CMakeLists.txt").read_text())[1],
      ext_modules=[Extension("tachless._tachless", [])], cmdclass={"build_ext": ByCMake})
