//! The kind of the tests, and an example of one: every reading is a line of text over TCP, and a
//! line that comes from there, such as `oven.k1 on`, is a command.

use super::kind::{Field, OutletKind, Pair, Shape, Work};
use super::outlet::Outlet;
use railbus_api::problem::{Problem, codes};
use railbus_app::api::ask;
use railbus_site::{Events, News, WriteTerms};
use tokio::io::{AsyncBufReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::net::TcpStream;

/// Lines of text over TCP.
pub(super) static KIND: OutletKind = OutletKind::new("textline", WORDS, FIELDS, run, test);

const WORDS: (Pair, Pair) = (
    ["Lines of text", "文本行"],
    ["Sends readings as lines of text.", "以文本行发送读数。"],
);
const FIELDS: &[Field] = &[
    Field {
        key: "host",
        title: ["Host", "主机"],
        hint: ["", ""],
        shape: Shape::Text(256),
        is_required: true,
    },
    Field {
        key: "port",
        title: ["Port", "端口"],
        hint: ["", ""],
        shape: Shape::Number(1, 65_535, 4_000),
        is_required: false,
    },
    Field {
        key: "quiet",
        title: ["Only takes commands", "仅接收命令"],
        hint: ["", ""],
        shape: Shape::Flag,
        is_required: false,
    },
    Field {
        key: "write",
        title: ["Outputs that it may switch", "允许操作的输出"],
        hint: ["", ""],
        shape: Shape::Points,
        is_required: false,
    },
];

fn run(outlet: Outlet, _: Events) -> Work<Result<(), Problem>> {
    Box::pin(async move {
        let is_quiet = outlet.settings.borrow().get("quiet") == Some(&true.into());
        let (from, mut to) = connect(&outlet).await?.into_split();
        let mut commands = BufReader::new(from).lines();
        let (mut site, stopped) = (outlet.service.follow(), outlet.stopped());
        tokio::pin!(stopped);
        outlet.report.ready();
        loop {
            let line = tokio::select! {
                () = &mut stopped => return Ok(()),
                command = commands.next_line() => match command.map_err(lost)? {
                    Some(command) => switch(&outlet, &command).await,
                    None => return Err(lost("closed")),
                },
                news = site.next(), if !is_quiet => match news {
                    Some(News::Picture(picture)) => format!("points {}", picture.points.len()),
                    Some(News::Batch(batch)) => format!("changes {}", batch.points.len()),
                    None => return Ok(()),
                },
            };
            to.write_all(format!("{line}\n").as_bytes())
                .await
                .map_err(lost)?;
            outlet.report.worked();
        }
    })
}

fn test(outlet: Outlet) -> Work<Result<String, Problem>> {
    Box::pin(async move {
        Ok(connect(&outlet)
            .await?
            .peer_addr()
            .map_err(lost)?
            .to_string())
    })
}

async fn connect(outlet: &Outlet) -> Result<TcpStream, Problem> {
    let settings = outlet.settings.borrow().clone();
    let host = settings["host"].as_str().unwrap_or_default().to_owned();
    let port = settings.get("port").and_then(|port| port.as_u64());
    let port = port.and_then(|port| u16::try_from(port).ok());
    let stream = TcpStream::connect((host, port.unwrap_or(4_000))).await;
    stream.map_err(lost)
}

/// Carries out `oven.k1 on`, and says how it ended.
async fn switch(outlet: &Outlet, command: &str) -> String {
    let (path, to) = command.split_once(' ').unwrap_or((command, ""));
    let (module, point) = match ask::find(&outlet.service, path) {
        Ok(found) => found,
        Err(problem) => return format!("failed {}", problem.code),
    };
    let set = [(point, to == "on")];
    let end = outlet
        .service
        .write(&module, &set, WriteTerms::default())
        .await;
    end.map_or_else(
        |why| format!("failed {}", why.name()),
        |_| "done".to_owned(),
    )
}

fn lost(why: impl ToString) -> Problem {
    Problem::new(codes::HOOK_UNREACHED).with("reason", why.to_string())
}
