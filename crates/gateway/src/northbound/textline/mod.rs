//! The kind of the tests, and an example of one: every reading is a line of text over TCP, and a
//! line that comes from there, such as `oven.k1 on`, is a command.

use super::kind::{Field, OutletKind, Shape};
use super::outlet::Outlet;
use railbus_api::problem::{Problem, codes};
use railbus_site::{News, WriteTerms};
use tokio::io::{AsyncBufReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::net::TcpStream;

/// Lines of text over TCP.
pub(super) static KIND: OutletKind = OutletKind::new(
    "textline",
    (["Text", "文本"], ["Readings as text.", "以文本发送读数。"]),
    &[
        Field::new("host", ["Host", "主机"], Shape::Text(256)).required(),
        Field::new("port", ["Port", "端口"], Shape::Number(1, 65_535, 4_000)),
        Field::new("line", ["Line", "总线"], Shape::Line),
        Field::new("quiet", ["No readings", "不发读数"], Shape::Flag),
        Field::new("write", ["May switch", "允许操作的输出"], Shape::Points),
    ],
    |outlet, _| Box::pin(run(outlet)),
    |outlet| Box::pin(async move { connect(&outlet).await.map(|_| "connected".to_owned()) }),
);

async fn run(outlet: Outlet) -> Result<(), Problem> {
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
            news = site.next(), if !outlet.flag("quiet") => match news {
                Some(News::Picture(picture)) => format!("points {}", picture.points.len()),
                Some(News::Batch(batch)) => format!("changes {}", batch.points.len()),
                None => return Ok(()),
            },
        };
        to.write_all((line + "\n").as_bytes()).await.map_err(lost)?;
        outlet.report.worked();
    }
}

async fn connect(outlet: &Outlet) -> Result<TcpStream, Problem> {
    let at = format!("{}:{}", outlet.text("host"), outlet.number("port"));
    TcpStream::connect(at).await.map_err(lost)
}

/// Carries out `oven.k1 on`, and says how it ended.
async fn switch(outlet: &Outlet, command: &str) -> String {
    let words: Vec<&str> = command.split(['.', ' ']).collect();
    let [module, label, to] = words[..] else {
        return "failed unknown".to_owned();
    };
    let (point, site) = ((module, label), &outlet.service);
    let end = site.write_labelled(point, to == "on", WriteTerms::default());
    match end.await {
        Ok(_) => "done".to_owned(),
        Err(why) => format!("failed {}", why.name()),
    }
}

fn lost(why: impl ToString) -> Problem {
    Problem::new(codes::HOOK_UNREACHED).with("reason", why.to_string())
}
