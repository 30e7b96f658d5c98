#!/usr/bin/env python3
"""The live page of runs beside a program of this computer that asks the page for too much.

The log of a lock-step run stays the same. A run ends although connections are open. The page's process stays small.

live_attack.py TACHLESS SCENARIO    in a network of its own (tests/support/private_network.sh)

TACHLESS_PAGE_REQUESTS is the number of requests of each kind in each mode (default 100). From 1000 on, runs are longer, a
realtime run alternates with one that has no page, and the end of a run may take a second.
"""
import collections
import contextlib
import hashlib
import json
import multiprocessing
import os
import pathlib
import re
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time

MOST = int(os.environ.get("TACHLESS_PAGE_REQUESTS", "100"))
FULL = MOST >= 1000
MOST_RUNS = MOST // 4  # three are enough on an idle machine
SECONDS = 120
HELD = 40  # connections of a kind that are kept open

Kind = collections.namedtuple("Kind", "text more answer")
"""Bytes of a request; bytes that follow now and then on the connection, which stays open, or None; the server's answer beside
503, "" if it closes the connection without one."""


def kinds(port):
    get = f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
    events = get.replace("/", "/events?robot=ARM", 1)
    ranges = "Range: bytes=0-" + ",0-" * 1300
    return {
        "page": Kind(get + "\r\n", None, "200"),
        "stream": Kind(events + "\r\n", "", "200"),
        "slow headers": Kind(get, "X: y\r\n", ""),
        "huge headers": Kind(get + "X: y\r\n" * 4000, None, "431"),
        "ranges": Kind(f"{get}{ranges}\r\n\r\n", None, "200"),
        "gzip": Kind(get + "Accept-Encoding: gzip\r\n\r\n", None, "200"),
        "half open": Kind("GET / HT", "", ""),
        "body": Kind(get.replace("GET", "POST") + "Content-Length: 1000000000\r\n\r\n" + "x" * 10000, None, "405"),
        "garbage": Kind("\r\n\r\n" * 1000, None, "400")}


def missing(asked, counts):
    """Returns the names of the kinds of which requests, or their own answer, are still missing. A stream has its answer
    once the run is heard."""
    return [name for name, kind in asked.items() if counts[name].total() < MOST or counts[name][kind.answer] == 0]


class Attack:
    """Sends the missing requests of each kind, then some of every kind until `over`."""

    def __init__(self, port, counts, over):
        self.port, self.kinds, self.counts, self.over = port, kinds(port), counts, over
        self.held = collections.deque()
        self.lock = threading.Lock()

    def kind(self):
        first = missing(self.kinds, self.counts)
        return first[0] if first else min(self.kinds, key=lambda name: self.counts[name].total())

    def note(self, name, connection):
        connection.settimeout(0 if self.kinds[name].more is not None else 1)
        with contextlib.suppress(OSError):
            answer = connection.recv(4096).decode(errors="replace")
            return self.counts[name].update([answer[9:12]])
        self.counts[name].update([""])

    def ask(self):
        while not self.over.is_set():
            name = self.kind()
            text, more, _ = self.kinds[name]
            try:
                connection = socket.create_connection(("127.0.0.1", self.port), 1)
            except OSError:
                continue  # the run is over
            with contextlib.suppress(OSError):
                connection.settimeout(1)
                connection.sendall(text.encode())
            if more is None:
                self.note(name, connection)
                connection.close()
                continue
            self.hold(name, connection)

    def hold(self, name, connection):
        with self.lock:
            self.held.append((name, connection))
            given_up = self.held.popleft() if len(self.held) > HELD else None
            for other, each in self.held:
                with contextlib.suppress(OSError):
                    each.send(self.kinds[other].more.encode(), socket.MSG_DONTWAIT)
        if given_up:
            self.note(*given_up)
            given_up[1].close()

    def run(self):
        threads = [threading.Thread(target=self.ask) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        while self.held:
            self.note(*self.held.popleft())


def attack(port, counts, over, results):
    """A process with the low priority of the page: its own use of the processors is not what is tried."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(10)
    Attack(port, counts, over).run()
    results.put(counts)


def wait(what, is_so):
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        with contextlib.suppress(OSError):
            found = is_so()
            if found:
                return found
        time.sleep(0.02)
    raise AssertionError(f"waited {SECONDS} s for {what}")


def page_of(launcher):
    """The child of the launcher that is the same program."""
    own = pathlib.Path(f"/proc/{launcher}/exe").readlink()
    children = pathlib.Path(f"/proc/{launcher}/task/{launcher}/children").read_text().split()
    return next((int(child) for child in children if pathlib.Path(f"/proc/{child}/exe").readlink() == own), None)


def peak_megabytes(pid):
    return int(re.search(r"VmHWM:\s+(\d+)", pathlib.Path(f"/proc/{pid}/status").read_text()).group(1)) / 1024


class Runs:
    """Runs of one mode, and what was seen of them."""

    def __init__(self, tachless, scenario, folder, *options):
        self.command = [tachless, "run", scenario, "--run-id", "7", "--any-outcome", *options]
        self.folder, self.number = folder, 0
        self.counts = {name: collections.Counter() for name in kinds(0)}
        self.peaks, self.ends, self.digests = [], [], set()
        self.missed = {"alone": [], "attacked": []}

    def whole(self):
        assert self.number < MOST_RUNS, self.counts
        return not missing(kinds(0), self.counts)

    def take_results(self, out, kind):
        summary = json.loads((out / "summary.json").read_text())
        assert (out / "report.html").exists()
        self.missed[kind].append(summary["missed_commands"])
        self.digests.add(hashlib.sha256((out / "lcmlog").read_bytes()).hexdigest())
        (out / "lcmlog").unlink()

    def alone(self):
        out = self.folder / "alone"
        subprocess.run([*self.command, "--out", str(out), "--overwrite"], check=True, stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL)
        self.take_results(out, "alone")

    def attacked(self):
        self.number += 1
        out = self.folder / str(self.number)
        said = self.folder / f"{self.number}.txt"
        with open(said, "w") as stream:
            run = subprocess.Popen([*self.command, "--out", str(out), "--watch"], stdout=stream, stderr=stream)
        port = int(wait("the address", lambda: re.search(r"127.0.0.1:(\d+)/", said.read_text())).group(1))
        page = wait("the page's process", lambda: page_of(run.pid))
        over, results = multiprocessing.Event(), multiprocessing.Queue()
        attacker = multiprocessing.Process(target=attack, args=(port, self.counts, over, results))
        attacker.start()
        peak = 0
        while run.poll() is None:
            with contextlib.suppress(OSError, AttributeError):
                peak = max(peak, peak_megabytes(page))
            time.sleep(0.02)
        ended = time.time()
        over.set()
        self.counts = results.get(timeout=SECONDS)
        attacker.join()
        assert run.returncode == 0, said.read_text()
        assert not pathlib.Path(f"/proc/{page}").exists(), "the page's process has gone with the run"
        assert 0 < peak < 200, f"{peak} MB"
        self.peaks.append(peak)
        self.ends.append(ended - max(file.stat().st_mtime for file in out.iterdir()))
        self.take_results(out, "attacked")

    def check(self):
        for name, kind in kinds(0).items():
            # A connection that the end of a run cuts off has no answer. Before the run is heard there is no stream.
            expected = {kind.answer, "503", "", *(["404"] if name == "stream" else [])}
            assert set(self.counts[name]) <= expected, (name, self.counts[name])
        if FULL:
            assert max(self.ends) < 1, f"a run ended {max(self.ends)} s after its last result"

    def tell(self, mode):
        print(f"{mode}: {self.number} runs, page at most {max(self.peaks):.1f} MB, ended at most {max(self.ends):.3f} s after its "
              f"last result\n  requests with their answers:",
              *(f"\n    {name}: {count.total()} {dict(count)}" for name, count in self.counts.items()))
        print("  missed commands:", *(f"{kind} {counts}" + (f" median {statistics.median(counts)}" if counts else "")
                                      for kind, counts in self.missed.items()), flush=True)


def main():
    tachless, scenario = sys.argv[1:3]
    subprocess.run("ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo", shell=True, check=True)
    with tempfile.TemporaryDirectory() as folder:
        place = pathlib.Path(folder)
        for mode in "lockstep", "realtime":
            (place / mode).mkdir()
        lockstep = Runs(tachless, scenario, place / "lockstep", "--duration", "60" if FULL else "8")
        lockstep.alone()
        while not lockstep.whole():
            lockstep.attacked()
            assert len(lockstep.digests) == 1, "the log of a run is the same beside the attack"
        lockstep.tell("lockstep")
        lockstep.check()
        realtime = Runs(tachless, scenario, place / "realtime", "--mode", "realtime", "--duration", "20" if FULL else "4",
                        "--set", "loop.max_missed=1000000", "--set", "loop.max_missed_share=1")
        while not realtime.whole():
            if FULL:
                realtime.alone()
            realtime.attacked()
        realtime.tell("realtime")
        realtime.check()


if __name__ == "__main__":
    main()
