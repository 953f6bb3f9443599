//! The demo line. Its plant is the configuration of `railbus serve --demo`, including its changing
//! inputs.

use super::orders::Directory;
use super::plant::{self, PlantOptions};
use super::stage::Stage;
use super::system;
use railbus_app::failure::Failure;
use railbus_site::Config;
use railbus_words::Lang;

/// The name of its line.
pub(super) const LINE: &str = "main";

/// The configuration of the demo with its line at this port.
pub fn text(port: &str) -> String {
    include_str!("demo.toml").replace("PORT", port)
}

/// The demo line, ready to be served.
pub(super) fn stage(lang: Lang, seed: u64, verbose: bool) -> Result<(Stage, Directory), Failure> {
    let broken = || system(lang, std::io::Error::other("demo.toml"));
    let config = Config::parse(&text("pty:/tmp/line")).map_err(|_| broken())?;
    let directory = Directory::of(&config);
    let wanted = PlantOptions {
        seed: Some(seed),
        verbose,
        ..PlantOptions::default()
    };
    let stages = plant::stages(lang, &config, &directory, None, &wanted)?;
    let stage = stages.into_iter().next().ok_or_else(broken)?;
    Ok((stage, directory))
}

#[cfg(test)]
mod tests {
    use super::*;
    use railbus_sim::demo::{gate_inputs, modules, pump_inputs, tank_analogs};
    use railbus_sim::{Input, Output};
    use railbus_wire::Instant;

    #[test]
    fn it_is_the_demo_that_the_tutorials_speak_of() {
        let (mut stage, _) = stage(Lang::En, 0, false).unwrap();
        let setups = modules().map(|(name, setup)| (name.to_owned(), setup));
        let parts = || stage.parts().iter();
        for (name, setup) in setups {
            let part = parts().find(|part| part.name == name).unwrap();
            assert_eq!(part.setup, setup, "{name}");
        }
        assert_eq!(parts().count(), modules().len());
        for step in 0..2_500 {
            let now = Instant(step * 100_000);
            stage.handle(now, Input::Timeout);
            while !matches!(stage.poll(), Output::Wait(_)) {}
            let part = |name| stage.parts().iter().find(|part| part.name == name);
            assert_eq!(part("pump").unwrap().levels(), pump_inputs(now), "{now:?}");
            assert_eq!(part("gate").unwrap().levels(), gate_inputs(now), "{now:?}");
            let values = part("tank").unwrap().analogs();
            for (value, meant) in values.into_iter().zip(tank_analogs(now)) {
                assert!((value - meant).abs() <= 1, "{now:?}: {value} {meant}");
            }
        }
    }
}
