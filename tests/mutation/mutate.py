#!/usr/bin/env python3
"""Which faults of the code does no test notice?

Flips one operator or constant at a time, builds and runs the unit tests that are compiled from that
file, the file's own test first, until one fails, and writes down whether one did. The checkout itself
is not touched: each worker has a git worktree and a build of its own under build/mutation (--work).
Results are kept one a line in results.jsonl there; what is there is not tried again, so a run can be
ended and taken up.
A survivor that no test can kill is argued in tests/mutation/argued.txt.

    tests/mutation/mutate.py                       240 mutants, drawn evenly from all areas
    tests/mutation/mutate.py --area robot --number 20
    tests/mutation/mutate.py --survivors           those that survived, again: after new tests
    tests/mutation/mutate.py --list                what would be tried; builds nothing
    tests/mutation/mutate.py --report              the score and the survivors so far

Exit code 0 when every survivor is argued, 1 when one is not, 2 when the tests fail without a mutant.
Not part of ./tachless test: 240 mutants take hours.
"""

import argparse
import concurrent.futures
import hashlib
import json
import pathlib
import random
import re
import subprocess
import sys
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
ARGUED = pathlib.Path(__file__).with_name("argued.txt")

# Area: files, and the test programs that should notice a fault. Fuzzers, whole runs and compile-fail tests
# are left out.
AREAS = {
    "law": ("controller/law/*", r"test_controller(_laws)?|test_lyapunov"),
    "membership": ("core/session/membership* core/session/peers.h", r"test_session_membership"),
    "ticks": ("core/session/tick_master.h core/session/responders.h core/session/message_ring.h "
              "core/session/log_window.h", r"test_session_ticks"),
    "codec": ("core/messages/*wire* core/messages/codec* core/bus/lcm_packet* core/messages/truth/* core/messages/field*",
              r"test_messages\w*|test_bus_udp_transport"),
    "robot": ("core/robot/*", r"test_robot\w*|test_lyapunov_(parts|norm_conditions)"),
    "nodes": ("controller/node.cpp logger/node.cpp reference/node.cpp", r"test_(controller|logger|reference)"),
}

# Patterns and their replacements. clang-format puts operators between spaces, so that templates, pointers,
# references and #include do not match.
FLIPS = [
    (r" \+ ", " - "), (r" - ", " + "), (r" \* ", " / "), (r" / ", " * "),
    (r" \+= ", " -= "), (r" -= ", " += "),
    (r" < ", " <= "), (r" <= ", " < "), (r" > ", " >= "), (r" >= ", " > "),
    (r" == ", " != "), (r" != ", " == "), (r" && ", " || "), (r" \|\| ", " && "),
    (r"\btrue\b", "false"), (r"\bfalse\b", "true"),
    (r"(?<=[(\s])!(?=[a-z(])", ""), (r"(?<=[(\s,=])-(?=[a-z(])", ""),
    (r"(?<![\w.'\"])0(?![\w.'])", "1"), (r"(?<![\w.'\"])1(?![\w.'])", "2"),
    (r"(?<![\w.'\"])2(?![\w.'])", "3"), (r"\b0\.5\b", "0.25"),
    (r"\bstd::min\b", "std::max"), (r"\bstd::max\b", "std::min"),
    (r"\bsin\(", "cos("), (r"\bcos\(", "sin("),
]
SKIP = re.compile(r'^\s*(//|#|static_assert|template|using|namespace|friend|\[\[noreturn)|operator|throw |"')


def mutants(areas):
    """All mutants: dicts of id, area, file, line number, line before and after."""
    found = []
    for area in areas:
        for pattern in AREAS[area][0].split():
            for path in sorted(ROOT.glob(pattern)):
                if path.suffix not in (".h", ".cpp") or path.name == "main.cpp":
                    continue
                found += mutants_of(area, path)
    return found


def mutants_of(area, path):
    found, seen = [], {}
    name = str(path.relative_to(ROOT))
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if SKIP.search(line):
            continue
        code = line.split("//")[0]
        for before, after in FLIPS:
            for match in re.finditer(before, code):
                mutated = line[:match.start()] + after + line[match.end():]
                # The id uses the line's text instead of its number, so it stays when other lines come and go.
                text = hashlib.sha256((line.strip() + "\n" + mutated.strip()).encode()).hexdigest()[:8]
                seen[text] = seen.get(text, 0) + 1
                found.append({"id": f"{name}:{text}:{seen[text]}", "area": area, "file": name,
                              "number": number, "line": line, "mutated": mutated})
    return found


def drawn(all_mutants, number, seed):
    """The same draw for the same tree and seed, evenly over the areas."""
    by_area = {}
    for mutant in all_mutants:
        by_area.setdefault(mutant["area"], []).append(mutant)
    for each in by_area.values():
        random.Random(seed).shuffle(each)
    chosen, queues = [], [list(each) for each in by_area.values()]
    while len(chosen) < number and any(queues):
        for queue in queues:
            if queue and len(chosen) < number:
                chosen.append(queue.pop())
    return chosen


class Worker:
    """A worktree with a build of its own."""

    def __init__(self, work, index):
        self.tree = work / f"tree-{index}"
        self.build = self.tree / "build/release"
        self.run_s = {}
        self.compiled_from = {}
        commit = output("git", "-C", ROOT, "rev-parse", "HEAD").strip()
        if not self.tree.exists():
            subprocess.run(["git", "-C", ROOT, "worktree", "prune"], check=True)
            subprocess.run(["git", "-C", ROOT, "worktree", "add", "-q", "--detach", self.tree, commit],
                           check=True)
        subprocess.run(["git", "-C", self.tree, "checkout", "-q", "--force", commit], check=True)
        # An object with a precompiled header does not list that header among its dependencies.
        subprocess.run(["cmake", "-S", self.tree, "--preset", "release", "-DTACHLESS_TESTS=ON",
                        "-DCMAKE_DISABLE_PRECOMPILE_HEADERS=ON", "-DTACHLESS_UNITY=OFF",
                        "-DCMAKE_CXX_FLAGS_RELEASE=-O0"],
                       check=True, stdout=subprocess.DEVNULL)
        targets = output("ninja", "-C", self.build, "-t", "targets", "all")
        self.targets = sorted(set(re.findall(r"^(test_\w+): phony", targets, re.M)))

    def targets_of(self, area):
        return [target for target in self.targets if re.fullmatch(AREAS[area][1], target)]

    def targets_for(self, area, file):
        """Those with objects that are compiled from the file: the one with its own test first, then
        those with the least to compile. Known once all have been built."""
        if not self.compiled_from:
            objects = re.findall(r"^(\S+\.o): #deps.*\n((?:    .*\n)*)",
                                 output("ninja", "-C", self.build, "-t", "deps"), re.M)
            self.compiled_from = {name: set(files.split()) for name, files in objects}
        own_test = f"/{pathlib.Path(file).stem}_test.cpp.o"
        ranked = []
        for target in self.targets_of(area):
            objects = [each for each in output("ninja", "-C", self.build, "-t", "inputs", target).split()
                       if each.endswith(".o")]
            to_compile = sum(any(each.endswith("/" + file) for each in self.compiled_from.get(name, ()))
                             for name in objects)
            if to_compile:
                ranked.append((not any(each.endswith(own_test) for each in objects), to_compile, target))
        if not ranked:
            sys.exit(f"mutate: no test of {area} is compiled from {file}")
        return [target for *_, target in sorted(ranked)]

    def compile(self, target):
        return subprocess.run(["nice", "ninja", "-C", self.build, "-j1", target],
                              stdout=subprocess.DEVNULL).returncode == 0

    def passes(self, target, suites=()):
        program = next(self.build.glob(f"tests/**/{target}"))
        chosen = ":".join(f"{suite}.*:*/{suite}.*:{suite}/*" for suite in suites) or "*"
        inside = ("ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && "
                  f"exec {program} --gtest_fail_fast '--gtest_filter={chosen}'")
        began = time.monotonic()
        limit_s = 20 + 10 * self.run_s[target] if target in self.run_s else None  # None: without a mutant
        try:
            ended = subprocess.run(["unshare", "-rn", "bash", "-c", inside],
                                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                   timeout=limit_s)
        except subprocess.TimeoutExpired:
            return False
        self.run_s.setdefault(target, time.monotonic() - began)
        return ended.returncode == 0

    def baseline(self, areas):
        for area in areas:
            for target in self.targets_of(area):
                if not (self.compile(target) and self.passes(target)):
                    sys.exit(f"mutate: {target} fails without a mutant; mend it first")

    def outcome(self, mutant):
        """("killed", by), ("survived", None), or ("does not compile", None): not counted."""
        path = self.tree / mutant["file"]
        lines = path.read_text().splitlines(keepends=True)
        original = lines[mutant["number"] - 1]
        lines[mutant["number"] - 1] = mutant["mutated"] + "\n"
        path.write_text("".join(lines))
        try:
            for target in self.targets_for(mutant["area"], mutant["file"]):
                if not self.compile(target):
                    return "does not compile", None
                own = own_suites(mutant["file"])
                if (own and not self.passes(target, own)) or not self.passes(target):
                    return "killed", target
            return "survived", None
        finally:
            lines[mutant["number"] - 1] = original
            path.write_text("".join(lines))


def own_suites(file):
    """The suites of the file's own test, which are run before the others of the same program."""
    test = ROOT / "tests" / pathlib.Path(file).parent / f"{pathlib.Path(file).stem}_test.cpp"
    if not test.exists():
        return []
    return sorted(set(re.findall(r"^(?:TYPED_)?TEST(?:_[FP])?\((\w+),", test.read_text(), re.M)))


def output(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def results(work):
    file = work / "results.jsonl"
    if not file.exists():
        return {}
    return {each["id"]: each for each in map(json.loads, file.read_text().splitlines())}


def argued():
    """Lines `id  reason`; # begins a comment."""
    if not ARGUED.exists():
        return {}
    rows = [line.split(None, 1) for line in ARGUED.read_text().splitlines() if not line.startswith("#")]
    return {row[0]: row[1] for row in rows if len(row) == 2}


def report(work):
    """Prints score and survivors. @return how many survivors nobody has argued"""
    done, reasons, unargued = results(work), argued(), 0
    for area in AREAS:
        own = [each for each in done.values() if each["area"] == area]
        counted = [each for each in own if each["outcome"] != "does not compile"]
        killed = sum(each["outcome"] == "killed" for each in counted)
        if counted:
            print(f"{area:12} {killed:4} of {len(counted):4} killed, "
                  f"{len(own) - len(counted)} did not compile")
    for each in done.values():
        if each["outcome"] != "survived":
            continue
        unargued += each["id"] not in reasons
        print(f"\nsurvived: {each['id']}  ({each['file']}:{each['number']})\n"
              f"  - {each['line'].strip()}\n  + {each['mutated'].strip()}\n"
              f"  {reasons.get(each['id'], 'not argued')}")
    counted = [each for each in done.values() if each["outcome"] != "does not compile"]
    killed = sum(each["outcome"] == "killed" for each in counted)
    print(f"\n{len(counted)} mutants, {killed} killed, {len(counted) - killed} survived, "
          f"of these {unargued} not argued")
    return unargued


def run(chosen, workers, work):
    work.mkdir(parents=True, exist_ok=True)
    areas = sorted({mutant["area"] for mutant in chosen})
    idle, lock = [Worker(work, index) for index in range(workers)], threading.Lock()
    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        list(pool.map(lambda worker: worker.baseline(areas), idle))

        def one(mutant):
            with lock:
                worker = idle.pop()
            outcome, by = worker.outcome(mutant)
            with lock:
                idle.append(worker)
                with (work / "results.jsonl").open("a") as file:
                    file.write(json.dumps({**mutant, "outcome": outcome, "by": by}) + "\n")
                print(f"{outcome:16} {mutant['file']}:{mutant['number']}: {mutant['mutated'].strip()}",
                      flush=True)

        list(pool.map(one, chosen))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--area", choices=AREAS, action="append", help="only this one; may be repeated")
    parser.add_argument("--number", type=int, default=240, help="of mutants (default 240)")
    parser.add_argument("--seed", type=int, default=1, help="of the draw (default 1)")
    parser.add_argument("--workers", type=int, default=2, help="worktrees at work (default 2)")
    parser.add_argument("--work", type=pathlib.Path, default=ROOT / "build/mutation",
                        help="where worktrees and results are (default build/mutation)")
    parser.add_argument("--list", action="store_true", help="list the mutants and end")
    parser.add_argument("--survivors", action="store_true", help="try those that survived again")
    parser.add_argument("--report", action="store_true", help="report on the results so far and end")
    options = parser.parse_args()
    if not options.report:
        done = results(options.work)
        found = mutants(options.area or AREAS)
        if options.survivors:
            survived = {each for each in done if done[each]["outcome"] == "survived"}
            chosen = [each for each in found if each["id"] in survived - argued().keys()]
        else:
            chosen = [each for each in drawn(found, options.number, options.seed) if each["id"] not in done]
        if options.list:
            for each in chosen:
                print(f"{each['id']}  {each['file']}:{each['number']}\n"
                      f"  - {each['line'].strip()}\n  + {each['mutated'].strip()}")
            return 0
        run(chosen, options.workers, options.work)
    return 1 if report(options.work) else 0


if __name__ == "__main__":
    sys.exit(main())
