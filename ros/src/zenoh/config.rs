//! The session's configuration: the defaults of `rmw_zenoh`, overridden by the environment.

use zenoh::Config;

/// The defaults of `rmw_zenoh`: peers on this machine that a router connects with each other and with other
/// machines.
const DEFAULTS: [(&str, &str); 8] = [
    ("mode", r#""peer""#),
    ("connect/endpoints", r#"["tcp/localhost:7447"]"#),
    ("listen/endpoints", r#"["tcp/localhost:0"]"#),
    ("scouting/multicast/enabled", "false"),
    ("scouting/gossip/enabled", "true"),
    ("scouting/gossip/target", r#"{ router: ["router", "peer"], peer: ["router"] }"#),
    ("scouting/gossip/autoconnect_strategy", r#"{ peer: { to_router: "always", to_peer: "greater-zid" } }"#),
    // The history of latched messages needs timestamps.
    ("timestamping/enabled", "{ router: true, peer: true, client: true }"),
];

/// Reads `ZENOH_SESSION_CONFIG_URI`, the name of a file, and `ZENOH_CONFIG_OVERRIDE`, for example
/// `mode="client";connect/endpoints=["tcp/host:7447"]`. `get` reads a variable.
pub(super) fn configuration(get: impl Fn(&str) -> Option<String>) -> Result<Config, String> {
    const FILE: &str = "ZENOH_SESSION_CONFIG_URI";
    const OVERRIDE: &str = "ZENOH_CONFIG_OVERRIDE";
    let set = |name: &str| get(name).filter(|value| !value.is_empty());
    let mut config = match set(FILE) {
        Some(path) => Config::from_file(&path).map_err(|error| format!("{FILE} is `{path}`: {error}"))?,
        None => {
            let mut config = Config::default();
            for (key, value) in DEFAULTS {
                config.insert_json5(key, value).map_err(|error| format!("`{key}`: {error}"))?;
            }
            config
        }
    };
    for pair in set(OVERRIDE).iter().flat_map(|text| text.split(';')).filter(|pair| !pair.trim().is_empty()) {
        let fail = |reason: String| format!("{OVERRIDE} holds `{pair}`: {reason}");
        let (key, value) = pair.split_once('=').ok_or_else(|| fail("expected KEY=VALUE".to_owned()))?;
        config.insert_json5(key.trim(), value.trim()).map_err(|error| fail(error.to_string()))?;
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from(variables: &'static [(&str, &str)]) -> Result<Config, String> {
        configuration(|name| {
            variables.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn the_environment_is_read_as_rmw_zenoh_reads_it() {
        let text = |config: &Config, key: &str| config.get_json(key).unwrap();
        let config = from(&[]).unwrap();
        assert_eq!(text(&config, "scouting/multicast/enabled"), "false");
        let config = from(&[("ZENOH_CONFIG_OVERRIDE", "mode=\"client\";connect/endpoints=[\"tcp/a:1\"];")]);
        let config = config.unwrap();
        assert_eq!(text(&config, "mode"), "\"client\"");
        assert!(text(&config, "connect/endpoints").contains("tcp/a:1"));
    }

    #[test]
    fn what_is_wrong_in_it_is_named() {
        let fail = |variables| from(variables).expect_err("a bad variable");
        let error = fail(&[("ZENOH_SESSION_CONFIG_URI", "/none/such.json5")]);
        assert!(error.contains("ZENOH_SESSION_CONFIG_URI is `/none/such.json5`"), "{error}");
        assert!(fail(&[("ZENOH_CONFIG_OVERRIDE", "mode")]).contains("`mode`: expected KEY=VALUE"));
        assert!(fail(&[("ZENOH_CONFIG_OVERRIDE", "mode=\"king\"")]).contains("`mode=\"king\"`"));
    }
}
