"""What `railbus export` writes, taken by the programs that it is for: they accept it, they get the
values, and they get none that is not good."""

import json
import os
import pathlib
import re
import signal
import subprocess
import tomllib

import yaml

import tables
from exports import NodeRed, Prometheus, against_grafana
from judge.daemon import program
from modbus_tcp import until
from mqtt import Broker, Plant
from rig import Tally

tables.TABLES["exports"] = """
prometheus: {accepted,values,a module goes,alerts}
grafana: {as its types want it,its queries are answered,nothing of a daemon that is gone}
nodered over {MQTT,HTTP}: {loaded,values,switched,not known is null,guarded outputs have no button}
nodered over MQTT: {without a broker,switched without a broker,without railbus}
nodered over HTTP: a daemon that hangs
names with any character: {ha,ha over Modbus,telegraf,prometheus,rules,nodered,grafana}
"""

# How long something that must not come is waited for, in seconds.
GRACE = 8.0
# A name that no reader of a configuration likes.
ODD = "a\"b\\c: 'd' #e {{f}} ${g} - [h] %i 一号\u2028\u00a0"


class Site(Plant):
    """The plant, and its exports."""

    def __init__(self, broker):
        super().__init__(broker, "5", tally=Tally("exports"), write=["*"])

    def url(self):
        """Where the daemon listens."""
        log = (self.daemon.folder / "log").read_text(encoding="utf-8")
        return re.findall(r"http://127\.0\.0\.1:\d+", log)[-1]

    def railbus(self, *words):
        """What a command prints."""
        done = subprocess.run(
            [program(), *words, "--lang", "en"], capture_output=True, text=True, check=False,
            env={**os.environ, "RAILBUS_STATE": str(self.daemon.folder / "state")})
        if done.returncode:
            raise RuntimeError(f"{words}: {done.stderr}")
        return done.stdout

    def export(self, form, *words, config=None):
        """A file for another program."""
        config = str(config or self.daemon.config)
        return self.railbus("export", form, "--config", config, "--url", self.url(), *words)

    def token(self, role):
        """A token for a program in this role."""
        words = ("token", "create", role, "--role", role, "-o", "value")
        return self.railbus(*words, "--socket", self.daemon.socket).strip()


def monitored(s):
    """Prometheus follows the site, and the dashboard asks it."""
    folder = pathlib.Path(s.folder.name) / "prometheus"
    folder.mkdir()
    files = {
        "prometheus.yml": s.export("prometheus").replace('"15s"', '"1s"'),
        "railbus.rules.yml": s.export("prometheus", "--rules"),
        "railbus.token": s.token("viewer"),
        "test.yml": json.dumps(alerts(s)),
    }
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    prometheus = Prometheus(folder)
    try:
        for what, name in (("config", "prometheus.yml"), ("rules", "railbus.rules.yml")):
            s.check("prometheus: accepted", prometheus.checks("check", what, name), "", name)
        s.check("prometheus: alerts", prometheus.checks("test", "rules", "test.yml"), "")
        prometheus.start()
        scraped(s, prometheus)
        asked(s, prometheus)
        gone(s, prometheus)
    finally:
        prometheus.close()


def scraped(s, prometheus):
    """What it got, and what it gets when a module goes."""
    entry = "prometheus: values"
    up = lambda: prometheus.values("railbus_module_up")
    online = {("main", name): 1.0 for name in ("hall", "oven", "tank")}
    until(lambda: up() == online)
    s.check(entry, up(), online, "modules")
    values = prometheus.values("railbus_point_value")
    got = [values.get(point) for point in (("hall", "di0"), ("oven", "k1"), ("tank", "ai1"))]
    s.check(entry, got, [1.0, 0.0, 8.71], "points")
    entry = "prometheus: a module goes"
    s.sim.do("power oven off")
    gone = {("main", "hall"): 1.0, ("main", "oven"): 0.0, ("main", "tank"): 1.0}
    until(lambda: up() == gone)
    s.check(entry, up(), gone, "modules")
    # A scrape later at most; what is no longer told ends at once.
    left = lambda: [point for point in prometheus.values("railbus_point_value")
                    if point[0] == "oven"]
    until(lambda: not left())
    s.check(entry, left(), [], "points")
    names = lambda: {each["labels"]["alertname"] for each in
                     (prometheus.api("alerts") or {"alerts": []})["alerts"]}
    until(lambda: "RailbusModuleOffline" in names())
    s.check("prometheus: alerts", names(), {"RailbusModuleOffline"}, "pending")
    rules = prometheus.api("rules")["groups"][0]["rules"]
    s.check("prometheus: alerts", {each["health"] for each in rules}, {"ok"}, "all rules")
    s.sim.do("power oven on")
    until(lambda: up() == online)


def asked(s, prometheus):
    """The dashboard."""
    dashboard = json.loads(s.export("grafana"))
    s.check("grafana: as its types want it", against_grafana(dashboard), "")
    # That the types are held against at all.
    wrong = json.loads(json.dumps(dashboard))
    wrong["panels"][0]["options"]["textMode"] = "words"
    s.check("grafana: as its types want it", against_grafana(wrong) != "", True, "a wrong one")
    entry = "grafana: its queries are answered"
    for panel in dashboard["panels"]:
        for each in panel.get("targets", []):
            expr = each["expr"].replace("$__rate_interval", "1m")
            told = lambda expr=expr: (prometheus.api("query", query=expr) or {}).get("result")
            # Nothing fails, and these are rates: there may be none yet.
            if "> 0" in expr:
                s.check(entry, told() is None, False, expr)
            else:
                s.check(entry, bool(until(told)), True, expr)


def gone(s, prometheus):
    """What the numbers of the dashboard are when nobody is left to say them."""
    entry = "grafana: nothing of a daemon that is gone"
    stats = [panel for panel in json.loads(s.export("grafana"))["panels"]
             if panel["type"] == "stat"]
    targets = [each for panel in stats for each in panel["targets"]]
    s.check(entry, {(each["instant"], each["range"]) for each in targets}, {(True, False)})
    s.sim.do("power oven off")
    offline = next(each["expr"] for each in targets if "railbus_module_up" in each["expr"]
                   and "vector" in each["expr"])
    until(lambda: prometheus.values(offline) == {(): 1.0})
    s.check(entry, prometheus.values(offline), {(): 1.0}, "one module is offline")
    s.daemon.end("KILL")
    until(lambda: prometheus.values("up") == {(): 0.0})
    for each in targets:
        want = {(): 0.0} if each["expr"].startswith("up{") else {}
        s.check(entry, prometheus.values(each["expr"]), want, each["expr"])
    s.sim.do("power oven on")
    s.daemon.start()


def alerts(s):
    """What promtool is to try: what there is, and which alerts are then to be there."""
    site = yaml.safe_load(s.export("prometheus"))["scrape_configs"][0]["static_configs"][0]
    site = site["labels"]["site"]
    rules = yaml.safe_load(s.export("prometheus", "--rules"))["groups"][0]["rules"]
    of = f"site={json.dumps(site, ensure_ascii=False)}"
    good = {
        f'up{{job="railbus",{of}}}': 1, f"railbus_audit_up{{{of}}}": 1,
        f'railbus_line_up{{line="main",{of}}}': 1,
        f'railbus_line_busy_ratio{{line="main",{of}}}': 0.5,
        f'railbus_outlet_up{{kind="mqtt",outlet="scada",{of}}}': 1,
        **{f'railbus_module_up{{line="main",module="{name}",{of}}}': 1
           for name in ("hall", "oven", "tank")},
        **{f'railbus_point_value{{module="{module}",point="{point}",{of}}}': 0
           for module, points in POINTS.items() for point in points},
    }
    requests = lambda result: (f'railbus_requests_total{{line="main",module="oven",'
                               f'result="{result}",{of}}}')
    steady = {requests("ok"): "0+9x100", requests("timeout"): "0+0x100"}
    line = f'railbus_line_up{{line="main",{of}}}'
    oven = f'railbus_module_up{{line="main",module="oven",{of}}}'
    # Another gateway whose site has the same name.
    other = {f'railbus_module_up{{instance="b",line="main",module="{name}",{of}}}': 1
             for name in ("hall", "oven", "tank")}
    other[f'railbus_line_up{{instance="b",line="main",{of}}}'] = 1
    other |= {f'railbus_point_value{{instance="b",module="{module}",point="{point}",{of}}}': 0
              for module, points in POINTS.items() for point in points}
    cases = [
        ({}, set()),
        (other, set()),
        ({**other, f'railbus_line_up{{instance="b",line="main",{of}}}': 0, oven: 0},
         {"RailbusModuleOffline", "RailbusLineAbsent"}),
        ({**other, f'railbus_point_value{{module="oven",point="k3",{of}}}': None},
         {"RailbusValuesNotGood"}),
        ({f'up{{job="railbus",{of}}}': 0}, {"RailbusDown"}),
        ({f"railbus_audit_up{{{of}}}": 0}, {"RailbusAuditFails"}),
        ({oven: 0}, {"RailbusModuleOffline"}),
        # The line says it for all its modules.
        ({line: 0, oven: 0}, {"RailbusLineAbsent"}),
        ({f'railbus_point_value{{module="oven",point="k3",{of}}}': None},
         {"RailbusValuesNotGood"}),
        ({f'railbus_outlet_up{{kind="mqtt",outlet="scada",{of}}}': 0}, {"RailbusOutletDown"}),
        ({f'railbus_line_busy_ratio{{line="main",{of}}}': 0.95}, {"RailbusLineBusy"}),
        ({requests("timeout"): "0+1x100"}, {"RailbusExchangesFail"}),
    ]
    known = {each["alert"] for each in rules}
    tried = set().union(*(names for _, names in cases))
    s.check("prometheus: alerts", tried, known, "all are tried")
    return {
        "rule_files": ["railbus.rules.yml"], "evaluation_interval": "30s",
        "tests": [{
            "interval": "30s",
            "input_series": [
                {"series": series, "values": value if isinstance(value, str) else f"{value}x100"}
                for series, value in {**good, **steady, **changed}.items() if value is not None],
            "promql_expr_test": [{
                "expr": 'count by (alertname) (ALERTS{alertstate="firing"})', "eval_time": "40m",
                "exp_samples": [{"labels": f'{{alertname="{name}"}}', "value": 1}
                                for name in sorted(firing)],
            }],
        } for changed, firing in cases],
    }


POINTS = {
    "hall": [f"do{nth}" for nth in range(4)] + [f"di{nth}" for nth in range(4)],
    "oven": [f"k{nth}" for nth in range(1, 9)],
    "tank": ["k1", "k2", "ai1", "ai2"],
}


def wired(s, way):
    """Node-RED with the flow for this way."""
    words = ("--http",) if way == "HTTP" else ()
    flow = json.loads(s.export("nodered", *words))
    for each in flow:
        for variable in each.get("env", []):
            # As its user does, who enters it.
            variable |= {"type": "str", "value": s.token("operator")}
    red = NodeRed(flow)
    try:
        entry = f"nodered over {way}"
        s.check(f"{entry}: loaded", bool(red.runs()), True, "it starts")
        shows = lambda point, want: until(lambda: red.value(point) == want)
        known = {"oven.k1": False, "hall.di0": True, "hall.di1": False, "tank.ai1": 8.71}
        for point, want in known.items():
            shows(point, want)
            s.check(f"{entry}: values", red.value(point), want, point)
        buttons = red.buttons()
        guarded = [name for name in buttons if name.split(" ")[0] in ("k6", "k7")]
        s.check(f"{entry}: guarded outputs have no button", guarded, [])
        for word, bit in (("ON", 1), ("OFF", 0)):
            red.press("oven", f"k2 {word}")
            shows("oven.k2", bool(bit))
            s.check(f"{entry}: switched", red.value("oven.k2"), bool(bit), word)
            s.check(f"{entry}: switched", s.sim.outputs("oven")[1], bit, "the relay")
        s.sim.do("power oven off")
        shows("oven.k2", None)
        s.check(f"{entry}: not known is null", red.value("oven.k2"), None, "no power")
        s.check(f"{entry}: not known is null", red.value("hall.di0"), True, "another module")
        s.sim.do("power oven on")
        shows("oven.k2", False)
        s.check(f"{entry}: not known is null", red.value("oven.k2"), False, "again")
        failed = red.said("[error]") + red.said("Waiting for missing types")
        s.check(f"{entry}: loaded", failed, [], "it says")
        if way == "MQTT":
            without_broker(s, red)
            without_railbus(s, red)
        else:
            hanging(s, red)
    finally:
        red.close()


def without_broker(s, red):
    """The broker is away, and a relay is switched meanwhile."""
    entry = "nodered over MQTT: without a broker"
    shows = lambda point, want: until(lambda: red.value(point) == want)
    s.broker.kill()
    shows("hall.di0", None)
    s.check(entry, red.value("hall.di0"), None)
    # Each module has a node of its own.
    shows("oven.k2", None)
    since = red.count()
    s.ask("PUT", "/points/oven/k2", {"value": True})
    s.broker.start()
    shows("oven.k2", True)
    # Not what the broker's clients knew before.
    s.check("nodered over MQTT: switched without a broker", red.all("oven.k2", since), [True])
    shows("hall.di0", True)
    s.check(entry, red.value("hall.di0"), True, "again")


def without_railbus(s, red):
    """Broker and railbus are gone, and a broker comes back that has kept what railbus said."""
    entry = "nodered over MQTT: without railbus"
    s.broker.kill()
    until(lambda: red.value("oven.k2") is None)
    s.daemon.end("KILL")
    connected = len(red.said("Connected to broker"))
    s.broker.start()
    kept = {"bridge/state": "online", "oven/availability": "online", "oven/k2/state": "ON"}
    for topic, payload in kept.items():
        s.publish(topic, payload, "-r")
    since = red.count()
    if not until(lambda: len(red.said("Connected to broker")) > connected):
        raise RuntimeError("Node-RED does not find the broker again")
    until(lambda: red.count() > since, GRACE)
    s.check(entry, red.all("oven.k2", since), [], "kept by the broker")
    # That it would have been shown.
    s.publish("bridge/health", "{}")
    until(lambda: red.value("oven.k2") is True)
    s.check(entry, red.value("oven.k2"), True, "a sign of life")
    until(lambda: red.value("oven.k2") is None)
    s.check(entry, red.value("oven.k2"), None, "and no other one")


def hanging(s, red):
    """The daemon stands still, with its connections open."""
    entry = "nodered over HTTP: a daemon that hangs"
    os.kill(s.daemon.process.pid, signal.SIGSTOP)
    try:
        until(lambda: red.value("hall.di0") is None)
        s.check(entry, red.value("hall.di0"), None)
    finally:
        os.kill(s.daemon.process.pid, signal.SIGCONT)
    until(lambda: red.value("hall.di0") is True)
    s.check(entry, red.value("hall.di0"), True, "again")


def odd(s):
    """Names with everything in them are names, and nothing else."""
    folder = pathlib.Path(s.folder.name) / ODD.replace("/", "")
    folder.mkdir()
    config = folder / "railbus.toml"
    names = json.dumps(ODD, ensure_ascii=False)
    text = s.text(base="north/二")
    text = text.replace('model = "erc8"', f'model = "erc8"\nname = {names}\narea = {names}')
    text = text.replace("k4 = {", f"k4 = {{ name = {names}, ")
    text += '\n[outlet.plc]\ntype = "modbus_tcp"\nwrite = ["*"]\n'
    config.write_text(text, encoding="utf-8")
    export = lambda form, *words: s.export(form, *words, config=config)
    read = lambda form, *words: yaml.safe_load(export(form, *words))
    entry = "names with any character: "
    home = read("ha", "--outlet", "scada")["mqtt"]["switch"]
    [k4] = [each for each in home if each["unique_id"].endswith("_oven_k4")]
    s.check(entry + "ha", (k4["name"], k4["device"]["name"]), (ODD, ODD))
    plc = read("ha", "--outlet", "plc")["modbus"][0]["switches"]
    s.check(entry + "ha over Modbus", f"{ODD} {ODD}" in [each["name"] for each in plc], True)
    telegraf = tomllib.loads(export("telegraf"))["inputs"]
    s.check(entry + "telegraf", telegraf["http"][0]["tags"]["site"], ODD)
    job = read("prometheus")["scrape_configs"][0]
    s.check(entry + "prometheus", job["static_configs"][0]["labels"]["site"], ODD)
    (folder / "rules.yml").write_text(export("prometheus", "--rules"), encoding="utf-8")
    checked = subprocess.run(["promtool", "check", "rules", folder / "rules.yml"],
                             capture_output=True, text=True, check=False)
    s.check(entry + "rules", (checked.returncode, checked.stderr), (0, ""))
    flow = json.loads(export("nodered", "--http"))
    labels = [label for each in flow for label in each.get("outputLabels", [])]
    s.check(entry + "nodered", f"k4 {ODD}" in labels, True)
    board = json.loads(export("grafana"))
    shown = json.dumps(board, ensure_ascii=False)
    k4 = json.dumps(f"k4 {ODD}", ensure_ascii=False)
    s.check(entry + "grafana", (board["title"], k4 in shown), (f"railbus {ODD}", True))
    s.check(entry + "grafana", against_grafana(board), "")


def run():
    """Everything; returns the tally."""
    broker = Broker()
    try:
        with Site(broker) as s:
            s.settled()
            monitored(s)
            wired(s, "HTTP")
            wired(s, "MQTT")
            odd(s)
    finally:
        broker.close()
    return s.tally


SUITES = [("exports", run)]
