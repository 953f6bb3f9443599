"""What schemathesis is told beside the API's own document: names that are there, so that not
every question ends with "there is no such thing"."""

import schemathesis

# What a place in an address is called, and what of the demo it can hold.
THERE = {
    "module": ["pump", "oven", "gate", "yard", "tank", "spare"],
    "label": ["do0", "do1", "k1", "k2", "di0", "ai1"],
    "line": ["main", "spare"],
    "group": ["night", "spare"],
    "scene": ["evening", "spare"],
}
# Of them what may be changed and taken away: what all else is tried on stays.
SPARE = {name: ["spare"] for name in ("module", "line", "group", "scene")}
# The same of what follows the `?`.
ASKED = {
    "point": ["pump.do0", "oven.k1", "tank.ai1"],
    "select": ["pump.do0", "oven"],
    "module": ["pump", "oven"],
    "line": ["main"],
    "format": ["csv", "ndjson"],
    "lang": ["en", "zh"],
    "kind": ["write", "module", "config"],
    "fresh": ["1"],
    "limit": ["1", "500"],
    "from": ["0", "2026-01-01T00:00:00Z"],
    "to": ["2099-01-01T00:00:00Z"],
    "buckets": ["1", "100"],
}


@schemathesis.hook
def before_load_schema(context, schema):
    """Gives texts in addresses a choice of what is there; any other text stays possible."""
    for path, item in schema["paths"].items():
        places = THERE | (SPARE if path.startswith("/config/") else {})
        for operation in item.values():
            for parameter in operation.get("parameters", []):
                known = places if parameter["in"] == "path" else ASKED
                if values := known.get(parameter["name"]):
                    parameter["schema"] = {"anyOf": [{"enum": values}, parameter["schema"]]}
