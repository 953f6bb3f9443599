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
    /// A talk over a WebSocket at `path`.
    Talk {
        head: &'p str,
        path: &'p str,
        body: &'p str,
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
        let path = info.strip_prefix("websocket,");
        if let Some(path) = path {
            blocks.push(Block::Talk { head, path, body });
            rest = after;
            continue;
        }
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
