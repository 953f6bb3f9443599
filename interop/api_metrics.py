"""Checks `/metrics` with the OpenMetrics parser of prometheus_client, and against Prometheus'
conventions for names and values."""

import math

from prometheus_client.openmetrics.parser import text_string_to_metric_families

# Families that must exist, and their types.
WANTED = {
    "railbus_requests": "counter",
    "railbus_request_seconds": "histogram",
    "railbus_line_up": "gauge",
    "railbus_module_up": "gauge",
    "railbus_point_value": "gauge",
    "railbus_uptime_seconds": "gauge",
    "railbus": "info",
}
# Base units only [Prometheus, metric and label naming].
SCALED = ("_ms", "_milliseconds", "_us", "_microseconds", "_minutes", "_hours", "_kb", "_mb")
SCALED += ("_percent",)


def wrong(text):
    """What is wrong with a text of metrics."""
    try:
        families = list(text_string_to_metric_families(text))
    except ValueError as error:
        yield f"/metrics is no OpenMetrics: {error}"
        return
    print(f"OpenMetrics: {len(families)} families")
    types = {family.name: family.type for family in families}
    for name, kind in WANTED.items():
        if types.get(name) != kind:
            yield f"{name} is {types.get(name)}, and should be {kind}"
    for family in families:
        yield from wrong_family(family, text)


def wrong_family(family, text):
    """What is wrong with one family."""
    name = family.name
    if not family.documentation.strip() or f"# TYPE {name} " not in text:
        yield f"{name} has no HELP or no TYPE"
    if not name.startswith(("railbus", "process_")):
        yield f"{name} says not whose it is"
    if name.endswith((*SCALED, "_total", "_count", "_sum", "_bucket")):
        yield f"{name} ends in a unit that is not a base unit, or in a suffix"
    if not family.samples and name in WANTED:
        yield f"{name} has no value"
    for sample in family.samples:
        if family.type == "counter" and not sample.name.endswith(("_total", "_created")):
            yield f"{sample.name} counts and does not end in _total"
        if not math.isfinite(sample.value):
            yield f"{sample.name} is {sample.value}"
        if family.type in ("counter", "histogram") and sample.value < 0:
            yield f"{sample.name} is below nothing"
