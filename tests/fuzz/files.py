#!/usr/bin/env python3
"""Runs the commands on mutated scenarios, URDFs and logs.

files.py TACHLESS SCENARIOS KIND COUNT [SEED]   KIND: scenario, urdf, log

Each mutant follows from its number. A command may refuse it (documented exit codes) but must not
end by a signal, print "internal error" or a control character, or use more than 10 s of processor time
or 4 GiB of memory. It must not execute a text of the mutant; the inserted texts would create the file
CANARY. `certify` and `design` show their progress and may use 200 s, because on a slow machine `certify`
takes more than 10 s for seven flexible joints.
"""
import concurrent.futures
import os
import pathlib
import random
import re
import resource
import struct
import subprocess
import sys
import tempfile

MEMORY = 4 << 30
WEAPONS = [
    "$(touch CANARY)", "`touch CANARY`", "a\n!touch CANARY\n#", "'; touch CANARY; '", "|touch CANARY",
    '"; touch CANARY; "', "=cmd|'/c touch CANARY'!A1", "<script>alert(1)</script>", "../../CANARY",
    "\x1b]0;x\x07", "%n%s%s", "{0}{}{:>999999999}", "\u202e", "", "x" * 5000]
NUMBERS = [
    "0", "-0.0", "-1", "1", "1e308", "-1e308", "1e-308", "5e-324", "nan", ".nan", "inf", "-.inf", "null",
    "9223372036854775807", "9223372036854775808", "-9223372036854775809", "4294967296", "1e-9", "1e9", "~",
    "true", "[]", "{}", "[1, 2, 3, 4, 5, 6, 7, 8, 9]", "0x10", "1_000", "1 ", " 1", "''"]
NUMBER = re.compile(r"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
WORD = re.compile(r"[A-Za-z_]{3,}")


def replace_at(chance, text, pattern, choices):
    found = list(pattern.finditer(text))
    if not found:
        return text
    at = chance.choice(found)
    return text[:at.start()] + chance.choice(choices) + text[at.end():]


def mutated_text(chance, text):
    for _ in range(chance.choice([1, 1, 1, 2, 3, 8])):
        lines = text.splitlines(keepends=True) or ["\n"]
        line = chance.randrange(len(lines))
        kind = chance.randrange(10)
        if kind < 3:
            text = replace_at(chance, text, NUMBER, NUMBERS)
        elif kind == 3:
            text = replace_at(chance, text, WORD, WEAPONS)
        elif kind == 4:
            words = WORD.findall(text)
            text = replace_at(chance, text, WORD, words) if words else text
        elif kind == 5:
            text = "".join(lines[:line] + lines[line + 1:])
        elif kind == 6:
            other = chance.randrange(len(lines))
            text = "".join(lines[:line] + [lines[other]] + lines[line:])
        elif kind == 7:
            at = chance.randrange(len(text) + 1)
            text = text[:at] + chance.choice(list("{}[]<>:,&*!|>'\"%@`#\t\0\n ") + ["<<: ", "---\n", "&a [*a]"]) + text[at:]
        elif kind == 8:
            text = text[:chance.randrange(len(text) + 1)]
        else:
            at = chance.randrange(len(text) + 1)
            text = text[:at] + text[at:at + 40] * chance.choice([2, 50, 2000]) + text[at + 40:]
    return text.encode("utf-8", "surrogateescape")


HEADER = struct.Struct(">IQQII")  # sync word, number, time [us], lengths of channel and data
SYNC = 0xEDA1DA01


def events_of(log):
    events, at = [], 0
    while at + HEADER.size <= len(log):
        _, number, utime, channel, data = HEADER.unpack_from(log, at)
        at += HEADER.size
        events.append([number, utime, log[at:at + channel], log[at + channel:at + channel + data]])
        at += channel + data
    return events


def with_other_text(chance, data):
    """Replaces one of the texts in a message (length, characters, 0) by another text."""
    found = [at for at in range(len(data) - 5)
             if 2 <= (size := struct.unpack_from(">i", data, at)[0]) <= len(data) - at - 4
             and data[at + 3 + size] == 0 and data[at + 4:at + 3 + size].isascii()
             and 0 not in data[at + 4:at + 3 + size]]
    if not found:
        return data
    at = chance.choice(found)
    size = struct.unpack_from(">i", data, at)[0]
    old = data[at + 4:at + 3 + size].decode("ascii")
    new = mutated_text(chance, old) if len(old) > 40 else chance.choice(WEAPONS).encode()
    return data[:at] + struct.pack(">i", len(new) + 1) + new + b"\0" + data[at + 4 + size:]


def mutated_log(chance, log):
    events = events_of(log)
    for _ in range(chance.choice([1, 1, 2, 5])):
        which = 0 if chance.random() < 0.4 else chance.randrange(len(events))
        event = events[which]
        kind = chance.randrange(8)
        if kind < 3:
            event[3] = with_other_text(chance, event[3])
        elif kind == 3 and event[3]:
            at = chance.randrange(len(event[3]))
            event[3] = event[3][:at] + bytes([chance.randrange(256)]) + event[3][at + 1:]
        elif kind == 4 and len(event[3]) >= 8:
            at = chance.randrange(len(event[3]) - 7)
            value = chance.choice([b"\xff" * 8, b"\x7f\xf8" + b"\0" * 6, b"\x7f\xf0" + b"\0" * 6, b"\x7f" + b"\xff" * 7])
            event[3] = event[3][:at] + value + event[3][at + 8:]
        elif kind == 5:
            event[chance.randrange(2)] = chance.choice([0, 2**63 - 1, 2**64 - 1, 1])
        elif kind == 6:
            event[2] = chance.choice([e[2] for e in events] + [w.encode()[:60] for w in WEAPONS])
        else:
            other = chance.randrange(len(events))
            events[which], events[other] = events[other], events[which]
            if chance.random() < 0.5:
                del events[which]
            if not events:
                break
    result = b"".join(HEADER.pack(SYNC, n, t, len(c), len(d)) + c + d for n, t, c, d in events)
    if chance.random() < 0.3:
        damaged = bytearray(result)
        for _ in range(chance.choice([1, 4, 30])):
            damaged[chance.randrange(len(damaged))] = chance.randrange(256)
        result = bytes(damaged[:chance.randrange(len(damaged)) if chance.random() < 0.3 else None])
    return result


def commands_for(chance, kind):
    if kind == "scenario":
        short = ["--set", "loop.duration_s=0.02"] if chance.random() < 0.7 else []
        return [chance.choice([["certify", "mutant"], ["run", "mutant", "--in-process", *short]])]
    if kind == "urdf":
        return [["robot", "mutant.urdf"], *([["design", "mutant.urdf"]] if chance.random() < 0.02 else [])]
    return [chance.choice([["info", "mutant"], ["replay", "mutant"], ["export", "mutant"], ["report", "mutant"]])]


def limit(command):
    cpu_s = 200 if command[0] in ("certify", "design") else 10
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def complaint(tachless, scenarios, kind, seeds, number):
    """Returns the fault of the commands' reaction to this mutant; empty without a fault."""
    chance = random.Random(f"{kind} {number}")
    seed = chance.choice(seeds)
    mutant = mutated_log(chance, seed) if kind == "log" else mutated_text(chance, seed.decode())
    with tempfile.TemporaryDirectory() as directory:
        place = pathlib.Path(directory)
        (place / "robots").symlink_to(scenarios / "robots")
        (place / {"scenario": "mutant.yaml", "urdf": "mutant.urdf", "log": "mutant"}[kind]).write_bytes(mutant)
        for command in commands_for(chance, kind):
            words = [str(tachless), *(word + ".yaml" if kind == "scenario" and word == "mutant" else word for word in command)]
            ended = subprocess.run(words, cwd=place, preexec_fn=lambda: limit(command), stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            said = ended.stdout.decode("utf-8", "replace")
            long_run = ended.returncode == -9 and "k ticks/s" in said  # a run with a tiny period, which shows progress
            problem = (f"ends with {ended.returncode}" if ended.returncode not in range(0, 6) and not long_run else
                       "internal error" if "internal error" in said else
                       "a text of it was executed" if list(place.rglob("*CANARY*")) else
                       "a control character is printed" if re.search("[\x00-\x08\x0b\x0c\x0e-\x1f]", said) else "")
            if problem:
                kept = pathlib.Path(tempfile.gettempdir()) / f"tachless-{kind}-{number}"
                kept.write_bytes(mutant)
                return f"{kind} {number} ({kept}): {' '.join(command)}: {problem}\n{said[-1500:]}"
    return ""


def seeds_for(tachless, scenarios, kind):
    if kind == "urdf":
        return [path.read_bytes() for path in sorted(scenarios.glob("robots/*.urdf"))]
    if kind == "scenario":
        return [path.read_bytes() for path in sorted(scenarios.glob("*.yaml"))]
    logs = []
    with tempfile.TemporaryDirectory() as directory:
        for name in ["practical_rigid", "practical_flexible", "ur5e"]:
            out = pathlib.Path(directory) / name
            subprocess.run([tachless, "run", scenarios / f"{name}.yaml", "--in-process", "--set", "loop.duration_s=0.05",
                            "--out", out], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            logs += [path.read_bytes() for path in out.rglob("lcmlog")]
    return logs


def main():
    tachless, scenarios, kind, count = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve(), sys.argv[3], int(sys.argv[4])
    first = int(sys.argv[5]) if len(sys.argv) > 5 else 1
    seeds = seeds_for(tachless, scenarios, kind)
    assert seeds, "no seeds"
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        found = [each for each in pool.map(lambda number: complaint(tachless, scenarios, kind, seeds, number),
                                           range(first, first + count)) if each]
    print("\n\n".join(found), f"{count} mutants of {kind}s, {len(found)} complaints", sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
