#!/usr/bin/env python3
"""The live page of a run beside programs of this computer that ask it for too much: the log stays the same, the run ends
without waiting for them, and the page's process stays small.

live_attack.py TACHLESS SCENARIO [REQUESTS]    in a network of its own (tests/support/private_network.sh)
"""
import contextlib
import hashlib
import json
import pathlib
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time

SECONDS = 120


def wait(what, is_so):
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        with contextlib.suppress(OSError):
            found = is_so()
            if found:
                return found
        time.sleep(0.02)
    raise AssertionError(f"waited {SECONDS} s for {what}")


def requests_of(port):
    host = f"Host: 127.0.0.1:{port}\r\n"
    ranges = "Range: bytes=0-" + ",0-" * 1300 + "\r\n"
    return {
        "page": f"GET / HTTP/1.1\r\n{host}\r\n", "ranges": f"GET / HTTP/1.1\r\n{host}{ranges}\r\n",
        "gzip": f"GET / HTTP/1.1\r\n{host}Accept-Encoding: gzip\r\n\r\n",
        "headers": f"GET / HTTP/1.1\r\n{host}" + "X: y\r\n" * 4000,
        "body": f"POST / HTTP/1.1\r\n{host}Content-Length: 1000000000\r\n\r\n" + "x" * 10000,
        "garbage": "\r\n\r\n" * 1000, "events": f"GET /events?robot=ARM HTTP/1.1\r\n{host}\r\n", "half": "GET / HT"}


class Attack:
    """Sends requests of every kind, and holds some connections open that send a byte now and then."""

    def __init__(self, port, most):
        self.over, self.sent = threading.Event(), {}
        self.threads = [threading.Thread(target=self.ask, args=(port, kind, text.encode(), most))
                        for kind, text in requests_of(port).items()]
        self.threads.append(threading.Thread(target=self.hold, args=(port,)))
        for thread in self.threads:
            thread.start()

    def ask(self, port, kind, text, most):
        self.sent[kind] = 0
        while not self.over.is_set() and self.sent[kind] < most:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1) as connection:
                connection.settimeout(0.2)
                self.sent[kind] += 1
                connection.sendall(text)
                connection.recv(4096)

    def hold(self, port):
        held = []
        while not self.over.is_set():
            with contextlib.suppress(OSError):
                held.append(socket.create_connection(("127.0.0.1", port), 1))
            for connection in held:
                with contextlib.suppress(OSError):
                    connection.send(b"x")
            self.over.wait(0.05)
            held = held[-200:]

    def end(self):
        self.over.set()
        for thread in self.threads:
            thread.join()


def page_of(launcher):
    """The child of the launcher that is no other program."""
    own = pathlib.Path(f"/proc/{launcher}/exe").readlink()
    children = pathlib.Path(f"/proc/{launcher}/task/{launcher}/children").read_text().split()
    return next((int(child) for child in children if pathlib.Path(f"/proc/{child}/exe").readlink() == own), None)


def peak_megabytes(pid):
    return int(re.search(r"VmHWM:\s+(\d+)", pathlib.Path(f"/proc/{pid}/status").read_text()).group(1)) / 1024


def attacked(tachless, scenario, out, most, *options):
    """Runs beside the attack. Returns what is told of it."""
    said = out.parent / (out.name + ".txt")
    with open(said, "w") as stream:
        run = subprocess.Popen([tachless, "run", scenario, "--out", str(out), "--run-id", "7", "--watch", "--any-outcome", *options],
                               stdout=stream, stderr=stream)
        port = int(wait("the address", lambda: re.search(r"127.0.0.1:(\d+)/", said.read_text())).group(1))
        page = wait("the page's process", lambda: page_of(run.pid))
        attack = Attack(port, most)
        peak = 0
        while run.poll() is None:
            with contextlib.suppress(OSError, AttributeError):
                peak = max(peak, peak_megabytes(page))
            time.sleep(0.02)
        attack.end()
    assert run.returncode == 0, said.read_text()
    assert not pathlib.Path(f"/proc/{page}").exists(), "the page's process has gone with the run"
    assert 0 < peak < 200, f"{peak} MB"
    assert (out / "report.html").exists() and (out / "summary.json").exists()
    return {"peak_MB": round(peak, 1), "requests": attack.sent, "summary": json.loads((out / "summary.json").read_text())}


def main():
    tachless, scenario = sys.argv[1:3]
    most = int(sys.argv[3]) if len(sys.argv) > 3 else 300
    subprocess.run("ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo", shell=True, check=True)
    with tempfile.TemporaryDirectory() as directory:
        place = pathlib.Path(directory)
        duration = ["--duration", str(max(2.0, most / 30))]
        found = attacked(tachless, scenario, place / "attacked", most, *duration)
        subprocess.run([tachless, "run", scenario, "--out", str(place / "alone"), "--run-id", "7", "--any-outcome", *duration],
                       check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        digests = [hashlib.sha256((place / name / "lcmlog").read_bytes()).hexdigest() for name in ("attacked", "alone")]
        assert digests[0] == digests[1], "the log of a run is the same beside the attack"
        print("lockstep", found["peak_MB"], "MB", found["requests"])
        found = attacked(tachless, scenario, place / "realtime", most, "--mode", "realtime", "--duration", "4", "--set",
                         "loop.max_missed=1000000", "--set", "loop.max_missed_share=1")
        print("realtime", found["peak_MB"], "MB", found["requests"], "missed", found["summary"]["missed_commands"])


if __name__ == "__main__":
    main()
