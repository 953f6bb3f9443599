//! What two runs of a page have in common.

/// Names of measured numbers; also all that end in `_ms` or `_bytes`.
const MEASURED: &[&str] = &["t", "at_us", "busy_percent"];

/// The same but for what differs from run to run: measured times, moments, numbers and keys that
/// are drawn, ports, and the width of the columns that hold them.
pub(crate) fn calm(text: &str) -> String {
    let mut calm = String::new();
    for line in text.lines() {
        // A busy machine may be so late that a scan takes the simulated modules for slow ones.
        if line.contains(" --timeout 400ms ") {
            continue;
        }
        // Chinese leaves no blank between a mark and the number after it.
        let line = drawn(line)
            .replace('；', "； ")
            .replace('，', "， ")
            .replace('：', "： ");
        let words: Vec<&str> = line.split_whitespace().collect();
        let is_unit = |word: &&str| {
            let word = word.trim_end_matches([',', '.', ';', '，', '。', '；']);
            matches!(word, "ms" | "s" | "毫秒" | "秒" | "%")
        };
        // How much noise there was, and during how many requests.
        let is_noisy = line.contains("(not a valid reply)") || line.contains("不是有效应答");
        let masked = words.iter().enumerate().map(|(at, word)| {
            let measured = word.parse::<f64>().is_ok() && words.get(at + 1).is_some_and(is_unit);
            let number = word.trim_end_matches([';', '；']);
            let is_noise = is_noisy && number.parse::<u16>().is_ok();
            let is_port = word.contains("127.0.0.1:");
            // A module of the simulator was late, where the machine was busy.
            let before = at.checked_sub(1).and_then(|at| words.get(at));
            let is_online = words.iter().any(|word| matches!(*word, "online" | "在线"));
            let is_late = is_online && before.is_some_and(is_unit) && word.parse::<u8>().is_ok();
            // The number of a process, in the log of a server.
            let inside = word
                .strip_prefix('[')
                .and_then(|word| word.strip_suffix(']'));
            let is_process = inside.is_some_and(|number| number.parse::<u32>().is_ok());
            match is_process
                || measured
                || is_noise
                || is_port
                || is_late
                || is_moment(word)
                || is_gap(word)
            {
                true => "#",
                false => *word,
            }
        });
        calm += &masked.collect::<Vec<_>>().join(" ");
        calm.push('\n');
    }
    calm
}

/// A line of JSON, CSV or a head without its moments, drawn numbers and measured values.
fn drawn(line: &str) -> String {
    let is_inside = |c: char| c.is_ascii_alphanumeric() || "_.:+-".contains(c);
    let mut calm = String::new();
    let (mut rest, mut before) = (line, "");
    while let Some(start) = rest.find(is_inside) {
        calm += &rest[..start];
        let token = &rest[start..];
        let end = token.find(|c| !is_inside(c)).unwrap_or(token.len());
        let (token, after) = token.split_at(end);
        let is_value = token.starts_with(':') && token.len() > 1;
        calm += match is_value && is_measured(before) {
            true => ":#",
            false if is_moment(token) || is_drawn(token) => "#",
            false => token,
        };
        (rest, before) = (after, token);
    }
    calm + rest
}

fn is_measured(name: &str) -> bool {
    MEASURED.contains(&name) || name.ends_with("_ms") || name.ends_with("_bytes")
}

/// A ULID, a token, a digest, or the key of a link.
fn is_drawn(word: &str) -> bool {
    let all = |allowed: fn(&u8) -> bool| word.bytes().all(|byte| allowed(&byte));
    let is_ulid = word.len() == 26 && all(|b| b.is_ascii_digit() || b.is_ascii_uppercase());
    let is_digest = word.len() >= 16 && all(u8::is_ascii_hexdigit);
    let is_key = word.matches('-').count() == 6 && word.len() == 34;
    is_ulid || is_digest || is_key || word.starts_with("rb_")
}

/// `12.4`, as gaps stand in a column of their own.
fn is_gap(word: &str) -> bool {
    let digits = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
    let parts = word.split_once('.');
    parts.is_some_and(|(whole, tenths)| digits(whole) && digits(tenths) && tenths.len() == 1)
}

/// `14:03:07.123`, or a date, alone or with a time.
fn is_moment(word: &str) -> bool {
    let digits = word.bytes().filter(u8::is_ascii_digit).count();
    let marks = word
        .bytes()
        .all(|b| b.is_ascii_digit() || b":.-TZ+".contains(&b));
    digits >= 5 && marks && (word.matches(':').count() >= 2 || word.matches('-').count() == 2)
}
