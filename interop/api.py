"""Third-party judges of the daemon's HTTP API: schemathesis sends what the API's own document
allows and forbids, and the OpenMetrics parser of prometheus_client reads the metrics.

`cargo xtask test` runs this from the root of the repository, with the Python of the peers.
"""

import http.client
import json
import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import time

import api_metrics
import rig
from judge.daemon import build

# The same for every run.
SEED = "20261122"
EXAMPLES = {"nobody": "4", "admin": "12"}
CHECKS = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
    "negative_data_rejection",
)
# The timeouts of a request and of a run, in seconds; exceeding one is a failure.
REQUEST_MAX = "30"
RUN_MAX = 600

SIM = "it pulls plugs and drops outputs with the power; tests/api/sim.rs orders it"

# Not called, with the reason; everything else is.
APART = {
    "/ws": "an upgrade, which schemathesis does not speak; tests/api/streams.rs does",
    "/watch": "a stream that ends only with its client; tests/api/streams.rs follows it",
    "/events/stream": "a stream that ends only with its client; tests/api/streams.rs follows it",
    "/frames/stream": "a stream that ends only with its client; tests/api/streams.rs follows it",
    "/frames": "records for as many seconds as it is asked to, up to ten minutes",
    "/sim/{line}": SIM,
    "/sim/{line}/line-faults": SIM,
    "/sim/{line}/{module}": SIM,
    "/sim/{line}/{module}/inputs": SIM,
    "/sim/{line}/{module}/faults": SIM,
    "/modules/{module}/settings/calibrate": "it has the line until it is answered; "
    "tests/api/calibration.rs answers it",
    "/modules/{module}/settings/recover": "it has the line for minutes; "
    "tests/api/recovery.rs asks it",
    "/ops/{op}/answer": "there is one to answer only while a calibration asks; so does that test",
    "/scans": "what it starts would have the line during all that follows; it is asked last",
    "/ops/{op}": "there is one only after a scan; it is asked last",
}
LAST = ("/scans", "/ops/{op}")

# Created for the configuration's own routes to break, so that the rest remains usable.
SPARE = [
    ("POST", "/config/lines", {"line": "spare", "port": "/dev/railbus-no-such-port"}),
    ("POST", "/config/modules", {"modules": [
        {"name": "spare", "line": "spare", "model": "erc8", "address": 9}]}),
    ("PUT", "/config/groups/spare", {"members": ["spare.k1"]}),
    ("PUT", "/config/scenes/spare", {"steps": [{"path": "spare.k1", "value": True}]}),
]


class Wrong(Exception):
    """A check has failed."""


class OverSocket(http.client.HTTPConnection):
    """HTTP over the daemon's socket: as its own user, who may do everything."""

    def __init__(self, path):
        super().__init__("localhost", timeout=60)
        self.path = path

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self.timeout)
        self.sock.connect(self.path)


class Daemon:
    """A daemon with a throw-away demo."""

    def __init__(self):
        self.folder = tempfile.TemporaryDirectory(prefix="railbus-api-")
        self.socket = os.path.join(self.folder.name, "socket")
        words = ["serve", "--demo", "--listen", "127.0.0.1:0", "--socket", self.socket]
        self.errors = open(os.path.join(self.folder.name, "stderr"), "w+")
        self.process = subprocess.Popen(
            [rig.target() / "debug/railbus", *words],
            stdout=subprocess.PIPE, stderr=self.errors, text=True,
            env={**os.environ, "RAILBUS_LANG": "en"},
        )
        self.origin = ""
        for line in self.process.stdout:
            if line.strip().startswith("web "):
                self.origin = line.split()[1].rstrip("/")
            if "Ctrl-C" in line:
                break

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(30)
        self.process.stdout.close()
        self.errors.close()
        self.folder.cleanup()

    def ask(self, method, path, body=None, base="/api/v1"):
        """Sends a request as its own user; returns status and text."""
        connection = OverSocket(self.socket)
        text = None if body is None else json.dumps(body)
        connection.request(method, base + path, text)
        answer = connection.getresponse()
        found = answer.status, answer.read().decode()
        connection.close()
        return found

    def get(self, path):
        """The JSON at a path."""
        status, text = self.ask("GET", path)
        if status != 200:
            raise Wrong(f"GET {path}: {status} {text}")
        return json.loads(text)

    def until(self, what, done):
        """Waits until a condition is true."""
        end = time.monotonic() + 60
        while not done():
            if time.monotonic() > end:
                raise Wrong(f"{what}: it never came")
            time.sleep(0.1)

    def outputs(self):
        """The outputs of the demo's modules, read from them now."""
        points = self.get("/points?fresh=1")["points"]
        return {
            f"{point['module']}.{point['label']}": point.get("value")
            for point in points
            if point["kind"] == "output" and point["module"] != "spare"
        }

    def entries(self):
        """All entries of the audit log, newest first."""
        found, cursor = [], ""
        while True:
            page = self.get(f"/audit?limit=500{cursor}")
            found += page["items"]
            if not page.get("next"):
                return found
            cursor = f"&cursor={page['next']}"


def schemathesis(daemon, token, paths):
    """Runs schemathesis; returns its failures as text."""
    words = ["run", f"{daemon.origin}/api/v1/openapi.json", "--no-color", "--seed", SEED]
    words += ["--max-examples", EXAMPLES["admin" if token else "nobody"]]
    words += ["--phases", "coverage,fuzzing"]
    words += ["--checks", ",".join(CHECKS), "--continue-on-failure", "--warnings", "off"]
    words += ["--generation-deterministic"]
    words += ["--request-timeout", REQUEST_MAX, *paths]
    if token:
        words += ["--header", f"Authorization: Bearer {token}"]
    program = pathlib.Path(sys.executable).with_name("schemathesis")
    hooks = {"SCHEMATHESIS_HOOKS": "api_hooks", "PYTHONPATH": str(rig.ROOT / "interop")}
    run = subprocess.run(
        [program, *words], env={**os.environ, **hooks}, cwd=daemon.folder.name,
        capture_output=True, text=True, timeout=RUN_MAX, check=False,
    )
    tail = [line for line in run.stdout.splitlines() if "generated" in line]
    print(f"schemathesis, {'with a token' if token else 'as nobody'}: {' '.join(tail).strip()}")
    return [] if run.returncode == 0 else [run.stdout + run.stderr]


def all_but(paths):
    """Arguments for every path but these."""
    return [word for path in paths for word in ("--exclude-path", path)]


def only(paths):
    """Arguments for these paths."""
    return [word for path in paths for word in ("--include-path", path)]


def moved_without_order(before, after, entries):
    """Outputs that have changed although nothing commanded it."""
    named = {(entry["module"], word) for entry in entries for word in words_of(entry["what"])}
    moved = [path for path in before if after.get(path) != before[path]]
    return [path for path in moved if tuple(path.split(".")) not in named]


def words_of(what):
    """The words of `do0=on do1=off` and `pulse k1 500ms`."""
    return what.replace("=", " ").split()


def is_sound(daemon):
    """What must hold whatever was sent: it answers, and nothing that it stores is damaged."""
    for path, base in (("/healthz", ""), ("/readyz", "")):
        status, text = daemon.ask("GET", path, base=base)
        if status != 200:
            yield f"{path}: {status} {text}"
    config = daemon.get("/config")
    if pathlib.Path(config["file"]).read_text() != config["text"] or not config["in_force"]:
        yield "the configuration's file is not what is in force"
    status, text = daemon.ask("POST", "/config/check", {"text": config["text"]})
    if status != 200 or json.loads(text)["problems"]:
        yield f"the configuration is not whole: {text}"
    verified = daemon.get("/audit/verify")
    if not verified["ok"]:
        yield f"the audit log is not whole: {verified}"


def as_nobody():
    """Without a token nothing is done at all."""
    with Daemon() as daemon:
        good(daemon)
        before, config = daemon.outputs(), daemon.get("/config")["text"]
        yield from schemathesis(daemon, None, all_but(APART.keys() - set(LAST)))
        if daemon.outputs() != before or daemon.entries():
            yield "somebody unknown switched something"
        if daemon.get("/config")["text"] != config or daemon.get("/users")["users"]:
            yield "somebody unknown changed something"
        yield from is_sound(daemon)


def as_admin():
    """With all rights nothing breaks, and nothing moves without a command."""
    with Daemon() as daemon:
        good(daemon)
        for method, path, body in SPARE:
            status, text = daemon.ask(method, path, body)
            if status != 200:
                raise Wrong(f"{method} {path}: {status} {text}")
        wish = {"name": "foreign", "role": "admin", "points": [], "expires_days": 1}
        token = json.loads(daemon.ask("POST", "/tokens", wish)[1])["token"]
        before = daemon.outputs()
        yield from schemathesis(daemon, token, all_but(APART))
        entries = daemon.entries()
        ended = [entry for entry in entries if entry.get("end") == "readback"]
        print(f"  {len(entries)} orders, {len(ended)} of them done and read back")
        if not ended:
            yield "no order went through: that was no test"
        for path in moved_without_order(before, daemon.outputs(), entries):
            yield f"{path} moved, and nobody ordered it"
        yield from is_sound(daemon)
        yield from schemathesis(daemon, token, only(LAST))
        yield from is_sound(daemon)
        yield from api_metrics.wrong(daemon.ask("GET", "/metrics?points=1", base="")[1])


def good(daemon):
    """Waits until every point is good."""
    points = lambda: daemon.get("/points")["points"]
    daemon.until("good points", lambda: all(p["quality"] == "good" for p in points()))


def main():
    """Runs everything; returns the exit code."""
    began = time.monotonic()
    build(always=True)
    failures = [*as_nobody(), *as_admin()]
    for failure in failures:
        print(f"FAILED {failure}")
    print(f"{len(failures)} failures in {time.monotonic() - began:.0f} s")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
