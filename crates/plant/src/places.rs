//! The places at which the lines of a plant are served.

use super::orders::Directory;
use super::plant::PlantOptions;
use super::texts::SimText;
use railbus_app::failure::Failure;
use railbus_app::socket;
use railbus_site::Config;
use railbus_site::config::LineConfig;
use railbus_words::Code;
use railbus_words::Lang;
use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::path::PathBuf;

/// The place of a line.
#[derive(Clone, Debug, Default)]
pub(super) struct Place {
    pub(super) pty: Option<PathBuf>,
    pub(super) tcp: Option<SocketAddr>,
}

/// The place of each line. For PTY and TCP alike, the flag takes precedence over the table `sim`,
/// and that over the port; without any of them, the PTY is in the user's own folder.
pub(super) fn places(
    lang: Lang,
    config: &Config,
    directory: &Directory,
    wanted: &PlantOptions,
) -> Result<Vec<Place>, Failure> {
    let mut places = vec![Place::default(); directory.lines.len()];
    for text in &wanted.ptys {
        let (line, path) = of_line(lang, directory, text, "--pty")?;
        places[line].pty = Some(path.into());
    }
    for text in &wanted.tcps {
        let (line, address) = of_line(lang, directory, text, "--tcp")?;
        let parsed = address.parse().map_err(|_| {
            let message = lang.fill(SimText::BadAddress, &[("value", &address)]);
            Failure::new(Code::Usage, message).with_try("--tcp main=127.0.0.1:4001")
        });
        places[line].tcp = Some(parsed?);
    }
    for (place, (name, line)) in places.iter_mut().zip(&config.lines) {
        let of_table = config.plant.lines.get(name);
        let of_port = place_of(line);
        let pty = of_table.and_then(|sim| sim.pty.as_ref().map(PathBuf::from));
        place.pty = place.pty.take().or(pty).or(of_port.pty);
        place.tcp = place
            .tcp
            .or(of_table.and_then(|sim| sim.tcp))
            .or(of_port.tcp);
        if place.pty.is_none() && place.tcp.is_none() {
            let folder = socket::own_folder().unwrap_or_else(std::env::temp_dir);
            place.pty = Some(folder.join(format!("railbus-sim-{name}")));
        }
    }
    check_places(lang, &places)?;
    Ok(places)
}

/// Refuses two lines at one place.
fn check_places(lang: Lang, places: &[Place]) -> Result<(), Failure> {
    let ptys = places.iter().filter_map(|place| place.pty.as_ref());
    let ptys = ptys.map(|path| path.display().to_string());
    let tcps = places.iter().filter_map(|place| place.tcp);
    let tcps = tcps
        .filter(|tcp| tcp.port() != 0)
        .map(|tcp| tcp.to_string());
    let mut taken = BTreeSet::new();
    for place in ptys.chain(tcps) {
        if taken.contains(&place) {
            let message = lang.fill(SimText::SamePlace, &[("place", &place)]);
            return Err(Failure::new(Code::SimPlant, message).with_try("railbus sim --help"));
        }
        taken.insert(place);
    }
    Ok(())
}

/// The local path of the configured port, if it is on this machine: a port elsewhere belongs to the
/// real plant.
fn place_of(line: &LineConfig) -> Place {
    let pty = line.port.strip_prefix("pty:").map(PathBuf::from);
    let tcp = line.port.strip_prefix("tcp:");
    let tcp = tcp.and_then(|address| address.replace("localhost", "127.0.0.1").parse().ok());
    let tcp = tcp.filter(|address: &SocketAddr| address.ip().is_loopback());
    Place { pty, tcp }
}

/// The line to which a flag's value applies, and the rest of the value.
fn of_line<'t>(
    lang: Lang,
    directory: &Directory,
    text: &'t str,
    flag: &str,
) -> Result<(usize, &'t str), Failure> {
    let lines = &directory.lines;
    let is_name = |name: &str| name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    if let Some((name, rest)) = text.split_once('=').filter(|(name, _)| is_name(name)) {
        let known = lines.iter().position(|known| known == name);
        return known.map(|line| (line, rest)).ok_or_else(|| {
            let names = lines.join(", ");
            let message = lang.fill(SimText::NoSuchLine, &[("name", &name), ("names", &names)]);
            Failure::new(Code::SimPlant, message).with_try("railbus sim --help")
        });
    }
    if lines.len() > 1 {
        let form = format!("{flag} {}={text}", lines[0]);
        let message = lang.fill(SimText::NameLine, &[("form", &form)]);
        return Err(Failure::new(Code::SimPlant, message).with_try(form));
    }
    Ok((0, text))
}
