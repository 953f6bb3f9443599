"""What schemathesis needs besides the API's own document: names that exist, so that not every
request ends with "not found"."""

import schemathesis

# Path parameters, and values that exist in the demo.
THERE = {
    "module": ["pump", "oven", "gate", "yard", "tank", "spare"],
    "label": ["do0", "do1", "k1", "k2", "di0", "ai1"],
    "line": ["main", "spare"],
    "group": ["night", "spare"],
    "scene": ["evening", "spare"],
}
# Those of them that may be changed and deleted; the others are needed for the rest.
SPARE = {name: ["spare"] for name in ("module", "line", "group", "scene")}
# The same for query parameters.
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
    """Offers existing names for path parameters; any other text stays possible."""
    for path, item in schema["paths"].items():
        places = THERE | (SPARE if path.startswith("/config/") else {})
        for operation in item.values():
            for parameter in operation.get("parameters", []):
                known = places if parameter["in"] == "path" else ASKED
                if values := known.get(parameter["name"]):
                    parameter["schema"] = {"anyOf": [{"enum": values}, parameter["schema"]]}
