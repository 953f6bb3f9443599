//! A page of the guide in its parts.

/// A part of a page. `head` is the line that opens a block.
#[derive(Debug)]
pub(crate) enum Block<'p> {
    Text(&'p str),
    File {
        name: &'p str,
        head: &'p str,
        body: &'p str,
    },
    Background {
        head: &'p str,
        command: &'p str,
        shown: &'p str,
    },
    Session {
        head: &'p str,
        commands: Vec<&'p str>,
    },
}

/// The parts of a page, in its order. Together they are the page.
pub(crate) fn blocks(page: &str) -> Vec<Block<'_>> {
    let mut blocks = Vec::new();
    let mut rest = page;
    while let Some((before, head, body, after)) = next_fence(rest) {
        blocks.push(Block::Text(before));
        let info = head.trim_start_matches('`').trim_end();
        let name = info.split_once(",file=").map(|(_, name)| name);
        blocks.push(match (info, name) {
            (_, Some(name)) => Block::File { name, head, body },
            ("console", None) => Block::Session {
                head,
                commands: body
                    .lines()
                    .filter_map(|line| line.strip_prefix("$ "))
                    .collect(),
            },
            ("console,background", None) => {
                let (first, shown) = body.split_once('\n').expect("a command");
                let command = first.strip_prefix("$ ").expect("a command");
                Block::Background {
                    head,
                    command,
                    shown,
                }
            }
            _ => Block::Text(&rest[before.len()..rest.len() - after.len()]),
        });
        rest = after;
    }
    blocks.push(Block::Text(rest));
    blocks
}

/// What stands before the next block, its first line, what is in it, and what follows.
fn next_fence(text: &str) -> Option<(&str, &str, &str, &str)> {
    let open = match text.starts_with("```") {
        true => 0,
        false => text.find("\n```")? + 1,
    };
    let (before, block) = text.split_at(open);
    let (head, inside) = block.split_at(block.find('\n')? + 1);
    let (body, after) = match inside.strip_prefix("```\n") {
        Some(after) => ("", after),
        None => {
            let close = inside.find("\n```\n")? + 1;
            (&inside[..close], &inside[close + 4..])
        }
    };
    Some((before, head, body, after))
}

/// The same but for what differs from run to run: measured times, moments, ports, and the width of
/// the columns that hold them.
pub(crate) fn calm(text: &str) -> String {
    let mut calm = String::new();
    for line in text.lines() {
        // Chinese leaves no blank between a mark and the number after it.
        let line = line
            .replace('；', "； ")
            .replace('，', "， ")
            .replace('：', "： ");
        let words: Vec<&str> = line.split_whitespace().collect();
        let is_unit = |word: &&str| {
            let word = word.trim_end_matches([',', '.', ';', '，', '。', '；']);
            matches!(word, "ms" | "s" | "毫秒" | "秒" | "%")
        };
        let masked = words.iter().enumerate().map(|(at, word)| {
            let measured = word.parse::<f64>().is_ok() && words.get(at + 1).is_some_and(is_unit);
            let is_port = word.contains("127.0.0.1:");
            match measured || is_port || is_moment(word) || is_gap(word) {
                true => "#",
                false => *word,
            }
        });
        calm += &masked.collect::<Vec<_>>().join(" ");
        calm.push('\n');
    }
    calm
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
