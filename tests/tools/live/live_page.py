#!/usr/bin/env python3
"""`tachless watch --web` in a real browser: curves and robot of a run that goes on move, the page follows
and pauses, joins late and leaves without a trace in the run's log, and answers nobody else.

live_page.py TACHLESS SCENARIO [PICTURE]    in a network of its own (tests/support/private_network.sh)
"""
import base64
import contextlib
import hashlib
import http.client
import json
import os
import pathlib
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time

SECONDS = 60  # how long to wait for anything


class Browser:
    """Chromium without a window, by its debugging protocol (a WebSocket)."""

    def __init__(self, directory, url):
        self.process = subprocess.Popen(
            ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--no-first-run",
             "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage",
             "--window-size=1280,1000", "--remote-debugging-port=0", f"--user-data-dir={directory}", url],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        port_file = pathlib.Path(directory) / "DevToolsActivePort"
        port = int(wait("the browser", lambda: port_file.exists() and port_file.read_text().split("\n")[0]))
        pages = wait("the browser's page", lambda: [
            page for page in json.loads(get(port, "/json")[1]) if page["type"] == "page" and page["url"].startswith("http")])
        path = re.sub(r"^ws://[^/]*", "", pages[0]["webSocketDebuggerUrl"])
        self.socket = socket.create_connection(("127.0.0.1", port), SECONDS)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
        self.left = b""
        while b"\r\n\r\n" not in self.left:
            self.left += self.socket.recv(4096)
        self.left = self.left.split(b"\r\n\r\n", 1)[1]
        self.number = 0

    def take(self, size):
        while len(self.left) < size:
            more = self.socket.recv(1 << 16)
            assert more, "the browser has closed the connection"
            self.left += more
        taken, self.left = self.left[:size], self.left[size:]
        return taken

    def receive(self):
        text = b""
        while True:
            first, size = self.take(2)
            if size == 126:
                size = int.from_bytes(self.take(2), "big")
            elif size == 127:
                size = int.from_bytes(self.take(8), "big")
            text += self.take(size)
            if first & 0x80:
                return json.loads(text)

    def call(self, method, **parameters):
        self.number += 1
        text = json.dumps({"id": self.number, "method": method, "params": parameters}).encode()
        mask = os.urandom(4)
        head = bytes([0x81]) + (bytes([0x80 | len(text)]) if len(text) < 126 else b"\xfe" + len(text).to_bytes(2, "big"))
        self.socket.sendall(head + mask + bytes(c ^ mask[i % 4] for i, c in enumerate(text)))
        while True:
            answer = self.receive()
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return answer["result"]

    def value(self, script):
        result = self.call("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")


def wait(what, is_so):
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        with contextlib.suppress(OSError, IndexError):
            found = is_so()
            if found:
                return found
        time.sleep(0.05)
    raise AssertionError(f"waited {SECONDS} s for {what}")


def get(port, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=SECONDS)
    connection.request(method, path, headers={"Host": f"127.0.0.1:{port}", **headers})
    answer = connection.getresponse()
    return answer.status, answer.read(), answer.headers


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def run_command(tachless, scenario, out, duration_s, *options, run_id=7):
    return [tachless, "run", scenario, "--out", str(out), "--run-id", str(run_id), "--duration", str(duration_s), *options]


@contextlib.contextmanager
def started(command, **options):
    process = subprocess.Popen(command, **options)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(SECONDS)


def refuses_others(port):
    assert get(port, "/", Host="attacker.example")[0] == 403, "another name for this computer is refused"
    assert get(port, "/events?robot=ARM", Host=f"attacker.example:{port}")[0] == 403
    for method in ["POST", "PUT", "DELETE", "OPTIONS"]:
        assert get(port, "/", method)[0] in (403, 404, 405), method
    status, page, headers = get(port, "/")
    assert status == 200 and "Access-Control-Allow-Origin" not in headers
    assert b"default-src 'none'" in page or b"No run yet" in page
    try:
        socket.create_connection(("127.0.0.2", port), 1).close()
        raise AssertionError("it listens on another address")
    except OSError:
        pass


VISUAL = rb"\u003cvisual>"  # as the page's data have it

STATE = """JSON.stringify({
  version: typeof report === 'undefined' ? 0 : report.state.version, t: globalThis.report?.data.end_s, at: globalThis.report?.state.t,
  drawn: globalThis.report_robot?.drawn && report_robot.robots.length,
  points: globalThis.report?.data.charts.map(chart => chart.curves.map(curve => curve.x.length)),
  last: globalThis.report?.data.charts[0]?.curves.map(curve => curve.y[curve.y.length - 1]),
  joints: globalThis.report_robot?.robots[0]?.bodies.map(body => body.quaternion.toArray()),
  status: document.querySelector('.status')?.textContent})"""


def data_of(page):
    text = page.decode()
    return json.JSONDecoder().raw_decode(text[text.index('{"charts":'):])[0]["charts"]


def check_page(browser):
    state = wait("curves that move", lambda: (s := json.loads(browser.value(STATE)))["version"] > 0 and s["drawn"] and s)
    later = wait("a later state", lambda: (s := json.loads(browser.value(STATE)))["version"] > state["version"] + 40 and s)
    assert later["t"] > state["t"] and later["at"] > state["at"], "time goes on and the cursor follows"
    assert later["last"] != state["last"] and later["joints"] != state["joints"], "curves and robot move"
    assert all(n > 20 for chart in later["points"] for n in chart), later["points"]
    assert "ticks/s" in later["status"], later["status"]
    browser.value("document.querySelector('#bar .play').click()")
    paused = json.loads(browser.value(STATE))
    wait("points while it pauses", lambda: json.loads(browser.value(STATE))["version"] > paused["version"] + 10)
    assert json.loads(browser.value(STATE))["at"] == paused["at"], "the cursor stays"
    browser.value(f"report.seek({state['at']})")
    assert json.loads(browser.value(STATE))["at"] == state["at"], "it goes back to what is kept"


def check_fault(browser):
    """A fault that ends a run comes without a newer tick; after a lost connection it comes again."""
    shown = browser.value("""(() => {
      const {state, data} = report;
      const last = {run: data.live, number: state.version + 1, t: data.end_s, curves: {}, rate: 0, jitter_us: 0,
                    missed: 0, saturated: [], events: ['the arm is gone']};
      for (const time of ['first', 'again']) report.take(last);
      return document.getElementById('happened').textContent.split('the arm is gone').length - 1;
    })()""")
    assert shown == 1, shown


def numbers_of(port, robot, most):
    """The numbers of a robot's stretches, as they come."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=SECONDS)
    connection.request("GET", "/events?robot=" + robot, headers={"Host": f"127.0.0.1:{port}"})
    answer, numbers = connection.getresponse(), []
    while len(numbers) < most:
        line = answer.readline()
        if line.startswith(b"data: "):
            numbers.append(json.loads(line[len(b"data: "):])["number"])
    connection.close()
    return numbers


def check_reconnection(browser, port):
    """Resets the connection at the browser's next packet, then lets it connect again."""
    rule = f"tcp dport {port} reject with tcp reset"
    subprocess.run(["nft", f"table inet cut {{ chain out {{ type filter hook output priority 0; {rule}; }}; }}"], check=True)
    wait("the loss to show", lambda: "no connection" in json.loads(browser.value(STATE))["status"])
    subprocess.run(["nft", "delete table inet cut"], check=True)
    lost = json.loads(browser.value(STATE))
    wait("points after it", lambda: json.loads(browser.value(STATE))["version"] > lost["version"] + 10)
    assert browser.value("report.data.charts.every(chart => chart.curves.every("
                         "curve => curve.x.every((x, i, all) => i === 0 || x >= all[i - 1])))"), "nothing is drawn twice"


def main():
    tachless, scenario = sys.argv[1:3]
    subprocess.run("ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo", shell=True, check=True)
    with tempfile.TemporaryDirectory() as directory:
        place = pathlib.Path(directory)
        with open(place / "watch.txt", "w+") as said, started([tachless, "watch", "--web", "--port", "0"], stdout=said) as watch:
            port = int(wait("the address", lambda: re.search(r"127.0.0.1:(\d+)/", (place / "watch.txt").read_text())).group(1))
            refuses_others(port)
            # On the wall clock: a run in lock-step takes every core it gets, and the page's server runs
            # at low priority. Whatever ticks a busy machine misses; ended when all is seen.
            with open(place / "run.txt", "w+") as own, started(
                    run_command(tachless, scenario, place / "watched", 3600, "--mode", "realtime", "--watch",
                                "--set", "loop.max_missed=1000000", "--set", "loop.max_missed_share=1",
                                "--set", "plant.drive.torque_limit_Nm=[900, 300]"),
                    stdout=own, stderr=own) as run:
                wait("the run's page", lambda: b'id="motion"' in get(port, "/")[1])
                assert VISUAL not in get(port, "/")[1], "a bus names no files"
                own_port = int(wait("its own address", lambda: re.search(
                    r"127.0.0.1:(\d+)/", (place / "run.txt").read_text())).group(1))
                wait("its own page with the URDF's visuals", lambda: VISUAL in get(own_port, "/")[1])
                refuses_others(port)
                assert all(chart["levels"] for chart in data_of(get(port, "/")[1]) if chart["name"].startswith("torque")), \
                    "a torque has its limits"
                browser = Browser(place / "profile", f"http://127.0.0.1:{port}/")
                try:
                    check_page(browser)
                    check_fault(browser)
                    check_reconnection(browser, port)
                    if len(sys.argv) > 3:
                        picture = browser.call("Page.captureScreenshot")["data"]
                        file = pathlib.Path(sys.argv[3])
                        file.parent.mkdir(exist_ok=True)
                        file.write_bytes(base64.b64decode(picture))
                finally:
                    browser.process.terminate()
                    browser.process.wait(SECONDS)
                run.send_signal(signal.SIGINT)
                assert run.wait(SECONDS) == 130, "Ctrl-C ends it in order: no thread of the page takes it"
                assert json.loads((place / "watched/summary.json").read_text())["fault"] == "interrupted"
            subprocess.run(run_command(tachless, scenario, place / "lockstep", 2), check=True, stdout=subprocess.DEVNULL)
            assert watch.poll() is None, "it goes on watching"
            with started(run_command(tachless, scenario, place / "second", 3600, "--quiet", "--set", "robot.name=second",
                                     run_id=8), stdout=subprocess.DEVNULL):
                wait("a list of two robots", lambda: get(port, "/")[1].count(b'href="/?robot=') == 2)
                numbers = numbers_of(port, "SECOND", 100)  # for 2.5 s: RUN_INFO comes once a second
                assert numbers == list(range(numbers[0], numbers[0] + 100)), f"of one run, each once: {numbers}"
            for robot in (b"ARM", b"SECOND"):
                assert b'"robot":"' + robot in get(port, "/?robot=" + robot.decode())[1], robot
        subprocess.run(run_command(tachless, scenario, place / "alone", 2), check=True, stdout=subprocess.DEVNULL)
        logs = [digest(place / name / "lcmlog") for name in ("lockstep", "alone")]
        assert logs[0] == logs[1], "a run that is watched has the same log"


if __name__ == "__main__":
    main()
