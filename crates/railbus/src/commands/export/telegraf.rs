//! Telegraf: values and metrics over HTTP.
//!
//! Not over MQTT: a broker tells a value that it has kept as if it were new, also long after
//! railbus has stopped. Here every value has the time at which it was read, and none that is not
//! good is taken.

use super::File;
use super::asked::{Asked, CERTIFICATE};
use super::quote::{comment, quoted};
use super::texts::ExportText;

/// Where Telegraf has its files.
const FOLDER: &str = "/etc/telegraf";

/// Fields of the measurement, the kinds of points that have them, and their type. One field can't
/// have two types.
const FIELDS: [(&str, &str, &str); 4] = [
    ("output", "on", "int"),
    ("input", "on", "int"),
    ("analog", "value", "float"),
    ("variable", "value", "float"),
];

/// A file for the folder `telegraf.d`.
pub(super) fn file(asked: &Asked<'_>) -> File {
    let token = format!("{FOLDER}/railbus.token");
    let certificate = format!("{FOLDER}/{CERTIFICATE}");
    let notes: Vec<String> = std::iter::once(asked.token("telegraf", "viewer", &token))
        .chain(asked.certificate(&certificate))
        .collect();
    let head = asked
        .lang
        .fill(ExportText::Telegraf, &[("site", &asked.site)]);
    let tls = match asked.url.is_tls {
        true => format!("  tls_ca = {}\n", quoted(&certificate)),
        false => String::new(),
    };
    let (url, site) = (&asked.url.origin, quoted(&asked.site));
    let mut text = comment(&head);
    notes.iter().for_each(|note| text += &comment(note));
    text += &format!(
        "
[[inputs.http]]
  urls = [{}]
  token_file = {}
{tls}  data_format = \"json_v2\"
  [inputs.http.tags]
    site = {site}
  [[inputs.http.json_v2]]
    measurement_name = \"railbus_point\"
",
        quoted(&format!("{url}/api/v1/points")),
        quoted(&token),
    );
    for (kind, field, of_type) in FIELDS {
        let path = format!("points.#(kind==\"{kind}\")#|#(quality==\"good\")#");
        text += &format!(
            "    [[inputs.http.json_v2.object]]
      path = {}
      optional = true
      timestamp_key = \"time\"
      timestamp_format = \"2006-01-02T15:04:05Z07:00\"
      tags = [\"path\", \"module\", \"label\"]
      included_keys = [\"value\", \"time\"]
      renames = {{ value = \"{field}\" }}
      fields = {{ value = \"{of_type}\" }}
",
            quoted(&path),
        );
    }
    text += &format!(
        "    [[inputs.http.json_v2.object]]
      path = \"points\"
      optional = true
      tags = [\"path\", \"module\", \"label\"]
      included_keys = [\"quality\"]

[[inputs.prometheus]]
  urls = [{}]
  metric_version = 2
  bearer_token = {}
{tls}  [inputs.prometheus.tags]
    site = {site}
",
        quoted(&format!("{url}/metrics")),
        quoted(&token),
    );
    File { text, notes }
}
