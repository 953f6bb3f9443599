//! What is asked for: the site, its flags, and the outlet that another program is to use.

use super::quote::quoted;
use super::texts::ExportText;
use crate::commands::Context;
use clap::ArgMatches;
use hyper::Uri;
use railbus_app::config_file::FoundConfig;
use railbus_app::failure::Failure;
use railbus_gateway::offered::{self, Offer, OfferWay};
use railbus_site::Config;
use railbus_site::config::{ModuleConfig, Name};
use railbus_words::{Code, Lang};

/// Where the daemon is, if nothing else is said.
pub(super) const URL: &str = "http://127.0.0.1:7485";
/// The daemon's certificate, where another program is.
pub(super) const CERTIFICATE: &str = "railbus.pem";

/// Where another program reaches the daemon.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct DaemonUrl {
    /// `http://127.0.0.1:7485`.
    pub(super) origin: String,
    /// `127.0.0.1:7485`.
    pub(super) target: String,
    /// `127.0.0.1`.
    pub(super) host: String,
    pub(super) is_tls: bool,
}

/// An address with `http` or `https`, and nothing but host and port.
pub(super) fn url(text: &str) -> Result<DaemonUrl, String> {
    let uri: Uri = text.parse().map_err(|_| String::new())?;
    let target = uri.authority().ok_or_else(String::new)?.as_str();
    let is_tls = match uri.scheme_str() {
        Some("http") => false,
        Some("https") => true,
        _ => return Err(String::new()),
    };
    let has_more = uri.query().is_some() || !matches!(uri.path(), "" | "/");
    if has_more || target.contains('@') {
        return Err(String::new());
    }
    let scheme = if is_tls { "https" } else { "http" };
    let host = uri.host().unwrap_or_default();
    Ok(DaemonUrl {
        origin: format!("{scheme}://{target}"),
        target: target.to_owned(),
        host: host.trim_matches(['[', ']']).to_owned(),
        is_tls,
    })
}

/// What is asked for.
#[derive(Debug)]
pub(super) struct Asked<'a> {
    pub(super) lang: Lang,
    form: &'a str,
    pub(super) config: &'a Config,
    pub(super) site: String,
    pub(super) url: DaemonUrl,
    /// Points over HTTP, even if there is an outlet.
    pub(super) is_http: bool,
    outlet: Option<&'a str>,
    offers: Vec<Offer>,
}

impl<'a> Asked<'a> {
    pub(super) fn of(
        context: &Context,
        matches: &'a ArgMatches,
        found: &'a FoundConfig,
    ) -> Asked<'a> {
        // The parser has a default.
        let url = matches.get_one::<DaemonUrl>("url").cloned();
        let text = |name: &str| matches.get_one::<String>(name).map(String::as_str);
        let form = text("FORM").unwrap_or_default();
        let asked = Asked::about((context.lang, form), found, url.unwrap_or_else(usual));
        Asked {
            outlet: text("outlet"),
            site: text("site").map_or(asked.site, str::to_owned),
            is_http: matches.get_flag("http"),
            ..asked
        }
    }

    /// The same without flags.
    pub(super) fn about(
        (lang, form): (Lang, &'a str),
        found: &'a FoundConfig,
        url: DaemonUrl,
    ) -> Asked<'a> {
        Asked {
            lang,
            form,
            config: &found.config,
            site: offered::site_name(&found.path),
            url,
            is_http: false,
            outlet: None,
            offers: offered::offers(&found.path, &found.config),
        }
    }

    /// The outlet that is to be used: the named one, or the only one that fits best. `fits` gives
    /// the rank of those that fit.
    ///
    /// # Errors
    /// The named one is not there or does not fit; or several fit.
    pub(super) fn offer(
        &self,
        fits: impl Fn(&OfferWay) -> Option<u8>,
    ) -> Result<Option<&Offer>, Failure> {
        let mut fitting: Vec<(u8, &Offer)> = Vec::new();
        fitting.extend(
            self.offers
                .iter()
                .filter_map(|offer| Some((fits(&offer.way)?, offer))),
        );
        let of = |names: &[&str], code| {
            let failure = Failure::of(self.lang, code).with_fact("known", names.to_vec());
            names.iter().fold(failure, |failure, name| {
                failure.with_try(format!("railbus export {} --outlet {name}", self.form))
            })
        };
        if let Some(name) = self.outlet {
            let named = fitting.iter().find(|(_, offer)| offer.outlet == name);
            return named.map(|(_, offer)| Some(*offer)).ok_or_else(|| {
                let known: Vec<&str> = fitting.iter().map(|(_, offer)| &*offer.outlet).collect();
                let failure = of(&known, Code::ExportNoOutlet).because(name);
                failure.with_fact("name", name)
            });
        }
        let best = fitting.iter().map(|(rank, _)| *rank).min();
        fitting.retain(|(rank, _)| Some(*rank) == best);
        match fitting[..] {
            [] => Ok(None),
            [(_, only)] => Ok(Some(only)),
            _ => {
                let known: Vec<&str> = fitting.iter().map(|(_, offer)| &*offer.outlet).collect();
                Err(of(&known, Code::ExportWhich).because(known.join(" ")))
            }
        }
    }

    /// The labels of Prometheus that select the site.
    pub(super) fn of_site(&self) -> String {
        format!("site={}", quoted(&self.site))
    }

    /// The labels of Prometheus that select the polled modules of the site. Metrics count a module
    /// that was never asked as down, which is not to be an alert.
    pub(super) fn of_polled(&self) -> String {
        let modules = self.config.modules.iter();
        let unpolled: Vec<&str> = modules
            .filter(|(_, module)| !module.plan.enabled)
            .map(|(name, _)| &**name)
            .collect();
        match unpolled.is_empty() {
            true => self.of_site(),
            // A name has no character that means something in a pattern.
            false => format!("{},module!~{}", self.of_site(), quoted(&unpolled.join("|"))),
        }
    }

    /// A host as the other program reaches it: what is this machine for the daemon is the daemon's
    /// machine for others.
    pub(super) fn reached(&self, host: &str) -> String {
        let address: Option<std::net::IpAddr> = host.parse().ok();
        let is_here = address.is_some_and(|a| a.is_loopback() || a.is_unspecified());
        match is_here || host.eq_ignore_ascii_case("localhost") {
            true => self.url.host.clone(),
            false => host.to_owned(),
        }
    }

    /// What a module or point is called; none if it has no name.
    pub(super) fn called<'n>(&self, en: Option<&'n str>, zh: Option<&'n str>) -> Option<&'n str> {
        match self.lang {
            Lang::En => en.or(zh),
            Lang::Zh => zh.or(en),
        }
    }

    /// What a module is called, or its name in paths.
    pub(super) fn module_name<'n>(&self, name: &'n str, module: &'n ModuleConfig) -> &'n str {
        let Name { en, zh } = &module.name;
        self.called(en.as_deref(), zh.as_deref()).unwrap_or(name)
    }

    /// What the point of this label is called; none if it has no name.
    pub(super) fn point_name<'n>(
        &self,
        module: &'n ModuleConfig,
        point: railbus_device::Point,
    ) -> Option<&'n str> {
        let about = module.points.get(&point)?;
        self.called(about.name_en.as_deref(), about.name_zh.as_deref())
    }

    /// How to make the token that a program needs, in this role.
    pub(super) fn token(&self, program: &str, role: &str, file: &str) -> String {
        let values: &[(&str, &dyn std::fmt::Display)] =
            &[("program", &program), ("role", &role), ("file", &file)];
        self.lang.fill(ExportText::Token, values)
    }

    /// That the daemon's certificate is needed, if it is.
    pub(super) fn certificate(&self, file: &str) -> Option<String> {
        let told = || self.lang.fill(ExportText::Certificate, &[("file", &file)]);
        self.url.is_tls.then(told)
    }
}

/// A name for what a file has of a site, which no other has: 16 digits from a hash (FNV-1a, 64
/// bits).
pub(super) fn id(site: &str, what: &str) -> String {
    let bytes = site.bytes().chain([0]).chain(what.bytes());
    let hash = bytes.fold(0xCBF2_9CE4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
    });
    format!("{hash:016x}")
}

/// The daemon where it is usually.
fn usual() -> DaemonUrl {
    DaemonUrl {
        origin: URL.to_owned(),
        target: "127.0.0.1:7485".to_owned(),
        host: "127.0.0.1".to_owned(),
        is_tls: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_host_and_port() {
        assert_eq!(url(URL), Ok(usual()));
        let far = url("https://[fd00::7]:7485/").unwrap();
        assert_eq!(
            (&*far.origin, &*far.host),
            ("https://[fd00::7]:7485", "fd00::7")
        );
        assert!(far.is_tls);
        for wrong in [
            "",
            "gate",
            "gate:7485",
            "ftp://gate",
            "http://",
            "http://u:p@gate",
            "http://gate/api",
            "http://gate/?a=1",
            "http://ga te",
        ] {
            assert!(url(wrong).is_err(), "{wrong}");
        }
    }
}
